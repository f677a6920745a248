//! A model as streamed SOG (developer.playcanvas.com, "Streamed SOG"), of which a browser loads what a view needs:
//! `lod-meta.json` has a tree of regions, each with several levels of detail, which are rows of SOG folders beside it.

use super::build::{axes_of, scales_of};
use super::{CHUNK, Node, build};
use crate::files::write_atomically;
use crate::local_space::LocalSpace;
use crate::scene::{Gaussians, SceneError, write_sog_folder};
use glam::Vec3;
use serde_json::{Value, json};
use std::path::Path;

/// Most levels: the coarsest has a sixteenth of the Gaussians.
const LEVELS: usize = 5;
/// A folder with more Gaussians takes no further region.
const FULL: usize = 512 * 1024;

/// Writes `lod-meta.json` into a folder, in scene units, and the folders `LEVEL_NUMBER` beside it; the number of Gaussians of
/// each level, the finest first.
///
/// # Errors
/// Those of [`Gaussians::validate`], [`SceneError::NoGaussians`] and [`SceneError::Write`].
pub fn write_streamed(folder: &Path, model: &Gaussians) -> Result<Vec<usize>, SceneError> {
    write_in_parts(folder, model, CHUNK, FULL)
}

/// With chunks of so many Gaussians, and folders that are full with so many.
fn write_in_parts(folder: &Path, model: &Gaussians, chunk: usize, full: usize) -> Result<Vec<usize>, SceneError> {
    model.validate()?;
    if model.is_empty() {
        return Err(SceneError::NoGaussians);
    }
    let place = LocalSpace::at(model.file_offset().unwrap_or_default());
    let chunks = build(model.in_space(place).into_owned(), chunk);
    let depth = depth(&chunks, 0);
    let levels = LEVELS.min(depth + 1);
    let mut streamed = Streamed {
        chunks,
        folder,
        full,
        antialiased: model.antialiased,
        levels: (0..levels).map(|_| Level::default()).collect(),
        names: Vec::new(),
    };
    let tree = streamed.node(0, depth + 1 - levels)?.1;
    (0..levels).try_for_each(|level| streamed.close(level))?;
    let counts: Vec<usize> = streamed.levels.iter().map(|level| level.count).collect();
    let meta = json!({
        "version": 1,
        "asset": {"generator": "ibgs"},
        "count": counts.iter().sum::<usize>(),
        "counts": counts,
        "lodLevels": levels,
        "lodErrors": false,
        "filenames": streamed.names,
        "tree": tree,
    });
    write_atomically(&folder.join("lod-meta.json"), |out| out.write_all(meta.to_string().as_bytes()))?;
    Ok(counts)
}

/// Chunks below one, along the longest way. Halves are equal but for one Gaussian, so no other way is shorter by two.
fn depth(chunks: &[(Node, Gaussians)], node: usize) -> usize {
    let below = chunks[node].0.children.into_iter().flatten().map(|child| 1 + depth(chunks, child as usize));
    below.max().unwrap_or(0)
}

/// Two corners.
type Bounds = [Vec3; 2];

fn joined(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// A level of detail of all regions.
#[derive(Default)]
struct Level {
    /// Gaussians of all of its folders.
    count: usize,
    /// The folder that is not written yet: its name, and the regions in it.
    open: Option<(String, Vec<Gaussians>)>,
    folders: usize,
}

struct Streamed<'a> {
    chunks: Vec<(Node, Gaussians)>,
    folder: &'a Path,
    full: usize,
    antialiased: bool,
    levels: Vec<Level>,
    names: Vec<String>,
}

impl Streamed<'_> {
    /// The tree below a chunk, whose regions begin so many chunks down.
    fn node(&mut self, node: usize, above: usize) -> Result<(Bounds, Value), SceneError> {
        let Some([left, right]) = self.chunks[node].0.children.filter(|_| above > 0) else {
            return self.region(node);
        };
        let (left, right) = (self.node(left as usize, above - 1)?, self.node(right as usize, above - 1)?);
        let bounds = joined(left.0, right.0);
        Ok((bounds, json!({"bound": described(bounds), "children": [left.1, right.1]})))
    }

    /// A region: its levels are the chunks of different depths below one.
    fn region(&mut self, node: usize) -> Result<(Bounds, Value), SceneError> {
        let (mut bounds, mut lods) = ([Vec3::INFINITY, Vec3::NEG_INFINITY], serde_json::Map::new());
        for level in 0..self.levels.len() {
            let gaussians = self.cut(node, self.levels.len() - 1 - level);
            bounds = joined(bounds, bounds_of(&gaussians));
            lods.insert(level.to_string(), self.place(level, gaussians)?);
        }
        Ok((bounds, json!({"bound": described(bounds), "lods": lods})))
    }

    /// What stands for a chunk so many chunks below it.
    fn cut(&self, node: usize, below: usize) -> Gaussians {
        match self.chunks[node].0.children {
            Some([left, right]) if below > 0 => {
                let mut both = self.cut(left as usize, below - 1);
                both.append(self.cut(right as usize, below - 1));
                both
            }
            _ => Gaussians { antialiased: self.antialiased, ..self.chunks[node].1.clone() },
        }
    }

    /// Puts a region into the open folder of a level; where it lies.
    fn place(&mut self, level: usize, gaussians: Gaussians) -> Result<Value, SceneError> {
        let own = &mut self.levels[level];
        let (name, parts) = own.open.get_or_insert_with(|| (format!("{level}_{}/meta.json", own.folders), Vec::new()));
        if parts.is_empty() {
            self.names.push(name.clone());
        }
        let file = self.names.iter().position(|known| known == name);
        let (offset, count) = (parts.iter().map(Gaussians::len).sum::<usize>(), gaussians.len());
        parts.push(gaussians);
        own.count += count;
        if offset + count > self.full {
            self.close(level)?;
        }
        Ok(json!({"file": file, "offset": offset, "count": count}))
    }

    /// Writes the open folder of a level.
    fn close(&mut self, level: usize) -> Result<(), SceneError> {
        let own = &mut self.levels[level];
        own.folders += 1;
        own.open.take().map_or(Ok(()), |(name, parts)| write_sog_folder(&self.folder.join(name), &parts))
    }
}

/// The box of all ellipsoids of one standard deviation.
fn bounds_of(gaussians: &Gaussians) -> Bounds {
    let each = gaussians.means.iter().zip(&gaussians.rotations).zip(0..).map(|((mean, rotation), index)| {
        let axes = axes_of(*rotation);
        let scales = scales_of(gaussians, index);
        let half = [0, 1, 2].map(|k| (axes.row(k) * scales).length() as f32);
        [Vec3::from(*mean) - Vec3::from(half), Vec3::from(*mean) + Vec3::from(half)]
    });
    each.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], joined)
}

fn described([low, high]: Bounds) -> Value {
    json!({"min": low.to_array(), "max": high.to_array()})
}

#[cfg(test)]
mod tests {
    use super::super::build::tests::cloud;
    use super::*;
    use crate::scene::read_gaussians;
    use std::fs;

    fn regions(node: &Value, found: &mut Vec<Value>) {
        match node["children"].as_array() {
            Some(children) => children.iter().for_each(|child| regions(child, found)),
            None => found.push(node.clone()),
        }
    }

    /// 64 chunks that are not full, 16 to a region, and two regions to a folder.
    #[test]
    fn regions_are_rows_of_the_folders_of_their_levels() {
        let folder = tempfile::tempdir().unwrap();
        let model = Gaussians { antialiased: true, ..cloud(2_000) };
        let counts = write_in_parts(folder.path(), &model, 50, 900).unwrap();
        assert!(counts.len() == LEVELS && counts[0] == model.len(), "{counts:?}");
        let halves = |pair: &[usize]| pair[0].abs_diff(2 * pair[1]) <= pair[0] / 4;
        assert!(counts.windows(2).all(halves), "{counts:?}");
        let meta: Value = serde_json::from_slice(&fs::read(folder.path().join("lod-meta.json")).unwrap()).unwrap();
        let mut found = Vec::new();
        regions(&meta["tree"], &mut found);
        assert_eq!(found.len(), 4);
        // Two folders of full detail; the other levels have one each.
        assert_eq!(meta["filenames"].as_array().unwrap().len(), 2 + 4);
        for (level, &count) in counts.iter().enumerate() {
            let mut next = std::collections::BTreeMap::<u64, u64>::new();
            for region in &found {
                let part = &region["lods"][level.to_string()];
                let [file, offset, count] = ["file", "offset", "count"].map(|key| part[key].as_u64().unwrap());
                let end = next.entry(file).or_default();
                assert_eq!(*end, offset);
                *end += count;
                let name = meta["filenames"][file as usize].as_str().unwrap();
                let rows = read_gaussians(&folder.path().join(name)).unwrap();
                assert!(rows.antialiased && name.starts_with(&format!("{level}_")), "{name}");
                let corner = |key: &str, k: usize| region["bound"][key][k].as_f64().unwrap() as f32;
                for mean in &rows.means[offset as usize..(offset + count) as usize] {
                    let inside = (0..3).all(|k| corner("min", k) < mean[k] && mean[k] < corner("max", k));
                    assert!(inside, "{mean:?} {region}");
                }
            }
            assert_eq!(next.values().sum::<u64>(), count as u64);
        }
        let back = read_gaussians(&folder.path().join("lod-meta.json")).unwrap();
        assert!(back.len() == model.len() && back.antialiased);
    }

    #[test]
    fn a_small_model_has_one_level() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(write_streamed(folder.path(), &cloud(100)).unwrap(), [100]);
        assert_eq!(read_gaussians(&folder.path().join("lod-meta.json")).unwrap().len(), 100);
        let none = Gaussians::with_capacity(0, 0);
        assert!(matches!(write_streamed(folder.path(), &none), Err(SceneError::NoGaussians)));
    }
}
