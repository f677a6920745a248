#set train
#stage adam

#kernel adam
//! Adam.
#import adam_full

#kernel adam_harmonics
//! Adam of the spherical harmonics.
#define HARMONICS
#import adam_full

#kernel adam_packed
//! Adam with packed moments.
#import adam_packed

#kernel adam_packed_harmonics
//! Adam of the spherical harmonics with packed moments.
#define HARMONICS
#import adam_packed
