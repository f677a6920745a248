//! Picks frames of a video: parts with equal camera motion, and of each part the sharpest frame.

use super::tool::Tool;
use crate::arguments;
use anyhow::{Result, bail};
use std::path::Path;

/// Size at which frames are looked at; the picture's shape does not matter.
const WIDTH: usize = 640;
const HEIGHT: usize = 360;
/// Cells of the coarse picture by which motion is measured.
const CELL: usize = 20;

/// Timestamps without gaps at the rate of the output, so that every version of ffmpeg writes each frame once.
const ONE_BY_ONE: &str = "setpts=N/(25*TB)";

/// What is known of a frame.
#[derive(Clone, Copy, Debug)]
struct Frame {
    /// Mean square of the Laplacian: large where edges are sharp.
    sharpness: f64,
    /// Mean absolute difference of the coarse picture from that of the frame before, of 255.
    motion: f64,
}

/// Writes at most `count` frames of a video as JPEG files into a folder; returns how many of how many frames.
///
/// # Errors
/// ffmpeg is missing, or cannot read the video.
pub fn extract(ffmpeg: &Tool, video: &Path, folder: &Path, count: usize) -> Result<[usize; 2]> {
    let frames = measure(ffmpeg, video)?;
    if frames.is_empty() {
        bail!("{} has no frames that ffmpeg can read", video.display());
    }
    let chosen = choose(&frames, count);
    let terms: Vec<String> = chosen.iter().map(|frame| format!("eq(n\\,{frame})")).collect();
    let filter = format!("select='{}',{ONE_BY_ONE}", terms.join("+"));
    let pattern = folder.join("frame_%05d.jpg");
    let output = arguments!["-v", "error", "-y", "-i", video, "-vf", filter, "-r", "25", "-q:v", "2", pattern];
    ffmpeg.run(&output, |_| {})?;
    Ok([chosen.len(), frames.len()])
}

fn measure(ffmpeg: &Tool, video: &Path) -> Result<Vec<Frame>> {
    let filter = format!("scale={WIDTH}:{HEIGHT}:flags=area,format=gray,{ONE_BY_ONE}");
    let output = arguments!["-v", "error", "-i", video, "-vf", filter, "-r", "25", "-f", "rawvideo", "-"];
    let (mut frames, mut before): (_, Option<Vec<f64>>) = (Vec::new(), None);
    ffmpeg.blocks(&output, WIDTH * HEIGHT, |gray| {
        let coarse = coarse(gray);
        let motion = before.as_ref().map_or(0.0, |before| difference(before, &coarse));
        frames.push(Frame { sharpness: sharpness(gray), motion });
        before = Some(coarse);
    })?;
    Ok(frames)
}

fn sharpness(gray: &[u8]) -> f64 {
    let at = |x: usize, y: usize| i64::from(gray[y * WIDTH + x]);
    let laplacian = |x, y| 4 * at(x, y) - at(x - 1, y) - at(x + 1, y) - at(x, y - 1) - at(x, y + 1);
    let rows = (1..HEIGHT - 1).map(|y| (1..WIDTH - 1).map(|x| laplacian(x, y).pow(2)).sum::<i64>());
    rows.sum::<i64>() as f64 / ((WIDTH - 2) * (HEIGHT - 2)) as f64
}

fn coarse(gray: &[u8]) -> Vec<f64> {
    let mut cells = vec![0.0; (WIDTH / CELL) * (HEIGHT / CELL)];
    for (i, value) in gray.iter().enumerate() {
        cells[(i / WIDTH / CELL) * (WIDTH / CELL) + i % WIDTH / CELL] += f64::from(*value) / (CELL * CELL) as f64;
    }
    cells
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64
}

/// The numbers of at most `count` frames in order: the video in parts of equal motion, and the sharpest frame of each.
fn choose(frames: &[Frame], count: usize) -> Vec<usize> {
    if frames.len() <= count {
        return (0..frames.len()).collect();
    }
    // A camera that stands still for a third of the video still gives a frame or two.
    let rest = 0.1 * frames.iter().map(|frame| frame.motion).sum::<f64>() / frames.len() as f64;
    let way: Vec<f64> = frames
        .iter()
        .scan(0.0, |way, frame| {
            *way += frame.motion + rest.max(1e-9);
            Some(*way)
        })
        .collect();
    let part = |i: usize| ((way[i] / way[frames.len() - 1] * count as f64) as usize).min(count - 1);
    let mut best: Vec<Option<usize>> = vec![None; count];
    for (i, frame) in frames.iter().enumerate() {
        let best = &mut best[part(i)];
        if best.is_none_or(|best| frames[best].sharpness < frame.sharpness) {
            *best = Some(i);
        }
    }
    best.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(motions: impl IntoIterator<Item = f64>) -> Vec<Frame> {
        motions.into_iter().map(|motion| Frame { sharpness: 1.0, motion }).collect()
    }

    #[test]
    fn short_videos_give_every_frame() {
        assert_eq!(choose(&frames([1.0; 4]), 4), [0, 1, 2, 3]);
        assert_eq!(choose(&frames([1.0; 4]), 9), [0, 1, 2, 3]);
    }

    #[test]
    fn of_each_part_the_sharpest_is_taken() {
        let mut video = frames([1.0; 40]);
        for sharp in [3, 12, 25, 38] {
            video[sharp].sharpness = 2.0;
        }
        assert_eq!(choose(&video, 4), [3, 12, 25, 38]);
    }

    #[test]
    fn where_the_camera_moves_faster_there_are_more_frames() {
        let video = frames((0..200).map(|i| if i < 100 { 1.0 } else { 3.0 }));
        let chosen = choose(&video, 40);
        assert!((38..=40).contains(&chosen.len()), "{chosen:?}");
        assert!(chosen.is_sorted());
        let slow = chosen.iter().filter(|&&i| i < 100).count();
        assert!((9..=13).contains(&slow), "{slow} of the slow half");
    }

    #[test]
    fn a_standing_camera_gives_frames_too() {
        let still = choose(&frames([0.0; 100]), 10);
        assert_eq!(still.len(), 10);
        let pause = choose(&frames((0..300).map(|i| if (100..200).contains(&i) { 0.0 } else { 2.0 })), 60);
        let paused = pause.iter().filter(|i| (100..200).contains(*i)).count();
        // 440 units of way in all, a part is 7.3 of them, and the pause takes 13.3.
        assert!((1..=3).contains(&paused), "{paused} while it stands");
    }

    #[test]
    fn sharp_edges_count_more_than_soft_ones() {
        let picture = |soft: usize| -> Vec<u8> {
            let value = |i: usize| ((i % WIDTH) / soft.max(1) % 2 * 200) as u8;
            let hard: Vec<u8> = (0..WIDTH * HEIGHT).map(value).collect();
            hard
        };
        assert!(sharpness(&picture(4)) > 2.0 * sharpness(&picture(16)));
        assert_eq!(sharpness(&vec![90; WIDTH * HEIGHT]), 0.0);
        let brighter = difference(&coarse(&vec![90; WIDTH * HEIGHT]), &coarse(&vec![100; WIDTH * HEIGHT]));
        assert!((brighter - 10.0).abs() < 1e-9, "{brighter}");
    }
}
