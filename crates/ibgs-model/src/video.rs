//! Videos of numbered frames, where ffmpeg is on the machine.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Why there is no video; the frames are there in any case.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// There is no ffmpeg.
    #[error("there is no `ffmpeg` on this machine, so the frames were not made into a video")]
    NoFfmpeg,
    /// ffmpeg failed.
    #[error("`ffmpeg` could not make {}: {reason}", path.display())]
    Failed {
        /// The video.
        path: PathBuf,
        /// The last line that ffmpeg said.
        reason: String,
    },
}

/// Name of a film's frame in its folder.
pub fn frame_name(index: usize) -> String {
    format!("{index:05}.png")
}

/// Makes `film.mp4` (H.264, even sides) of the first `frames` of the pictures `00000.png`, `00001.png` ... in a folder, in place
/// of an older one. More pictures may be left there from a longer film. `rate_factor` is that of H.264 (0 to 51, less is
/// better); none: the encoder's own.
///
/// # Errors
/// [`VideoError`]; the frames stay as they are.
pub fn encode(folder: &Path, frames: usize, fps: f64, rate_factor: Option<u32>) -> Result<PathBuf, VideoError> {
    let path = folder.join("film.mp4");
    let failed = |reason: String| VideoError::Failed { path: path.clone(), reason };
    let rate = fps.to_string();
    let quality = rate_factor.map(|factor| ["-crf".to_owned(), factor.to_string()]);
    let output = Command::new("ffmpeg")
        .args(["-hide_banner", "-loglevel", "error", "-y", "-framerate", &rate, "-i"])
        .arg(folder.join("%05d.png"))
        .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-frames:v", &frames.to_string()])
        .args(quality.iter().flatten())
        .arg(&path)
        .stdin(Stdio::null())
        .output();
    match output {
        Ok(output) if output.status.success() => Ok(path),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr);
            Err(failed(text.lines().last().unwrap_or("it gave no reason").to_owned()))
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(VideoError::NoFfmpeg),
        Err(error) => Err(failed(error.to_string())),
    }
}
