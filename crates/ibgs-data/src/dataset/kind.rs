//! The formats of scenes.

use serde::Serialize;
use std::fmt;

/// Format of a scene on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneKind {
    /// COLMAP model, binary.
    ColmapBinary,
    /// COLMAP model, text.
    ColmapText,
    /// `transforms.json` of nerfstudio or instant-ngp.
    Transforms,
    /// `transforms_train.json` and its companions, of the Blender scenes.
    Blender,
    /// Camera parameters of RealityCapture or RealityScan, CSV.
    RealityCapture,
    /// `poses_bounds.npy` of LLFF.
    Llff,
    /// `cameras_sphere.npz` or `cameras.npz` of NeuS and IDR.
    Neus,
}

impl fmt::Display for SceneKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SceneKind::ColmapBinary => "COLMAP, binary",
            SceneKind::ColmapText => "COLMAP, text",
            SceneKind::Transforms => "transforms.json",
            SceneKind::Blender => "Blender transforms",
            SceneKind::RealityCapture => "RealityCapture",
            SceneKind::Llff => "LLFF",
            SceneKind::Neus => "NeuS",
        })
    }
}
