/// How many values a kernel is for.
struct CountParams {
    /// Number of values.
    count: u32,
}

var<immediate> params: CountParams;
