// The same with the gradients by the planes.
#define SURFACE
#import sum_rows
