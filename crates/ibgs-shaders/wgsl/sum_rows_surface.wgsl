//! As [`SUM_ROWS`], with the gradients by the planes.
#set train
#stage project backward
// The same with the gradients by the planes.
#define SURFACE
#import sum_rows
