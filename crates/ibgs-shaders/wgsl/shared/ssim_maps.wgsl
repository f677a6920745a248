// The three derivative maps of SSIM (the buffer `moments`, see ssim_moments) under the window once more, backward.
#import ssim
#if NARROW
#import ssim_maps_narrow
#else
#import ssim_maps_wide
#endif
