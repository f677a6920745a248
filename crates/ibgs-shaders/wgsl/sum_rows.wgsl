//! Gradients of each Gaussian's intersections, summed.
#set train
#stage project backward
// Sums of the gradients of each Gaussian's intersections.
#import sum_rows
