// Sums of the gradients of each Gaussian's intersections.
#import sum_rows
