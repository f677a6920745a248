/// Number of values.
var<immediate> count: u32;
