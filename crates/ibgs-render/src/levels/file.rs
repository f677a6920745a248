//! The chunks in a file: `levels.json` has the tree, `levels.bin` the numbers of one chunk after the other, float32 in the order of
//! [`PerGaussian`], each kind for all Gaussians of the chunk.

use super::{CHUNK, Node};
use crate::gpu::GpuError;
use crate::local_space::LocalSpace;
use crate::scene::{Gaussians, MAX_SH_DEGREE, PerGaussian};
use bytemuck::{cast_slice, cast_slice_mut};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// The tree as a part of a bundle.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    space: LocalSpace,
    sh_degree: u32,
    nodes: Vec<Node>,
}

/// A model as a tree of chunks in a file.
#[derive(Debug)]
pub struct Levels {
    /// Its local coordinates.
    pub space: LocalSpace,
    /// Degree of the spherical harmonics.
    pub sh_degree: u32,
    /// The root first, parents before children.
    pub nodes: Vec<Node>,
    /// The parent of each; the root's is itself.
    pub(super) parents: Vec<u32>,
    /// Numbers before each chunk.
    starts: Vec<u64>,
    /// Where the numbers begin in the file.
    begin: u64,
    file: Mutex<File>,
    path: PathBuf,
}

/// Halves of halves of any number of Gaussians.
const MOST_DEPTH: u32 = 40;

/// Numbers of a Gaussian.
fn width(coefficients: usize) -> usize {
    PerGaussian::rows(coefficients).into_array().iter().sum()
}

impl Tree {
    /// The tree of these chunks, in their order.
    pub fn of(space: LocalSpace, sh_degree: u32, chunks: &[(Node, Gaussians)]) -> Self {
        Self { space, sh_degree, nodes: chunks.iter().map(|(node, _)| node.clone()).collect() }
    }

    /// Bytes of all chunks.
    pub fn bytes(&self) -> u64 {
        let coefficients = (self.sh_degree as usize + 1).pow(2);
        4 * width(coefficients) as u64 * self.nodes.iter().map(|node| u64::from(node.count)).sum::<u64>()
    }

    /// What is wrong with it, if anything is: chunks would be missing or come twice.
    fn fault(&self) -> Option<&'static str> {
        let (mut next, count) = (1, self.nodes.len());
        let mut depths = vec![0u32; count];
        for (index, node) in self.nodes.iter().enumerate() {
            if let Some([left, right]) = node.children {
                if [left as usize, right as usize] != [next, next + 1] || next <= index || next + 1 >= count {
                    return Some("`children` are not in the order of a tree");
                }
                let depth = depths[index] + 1;
                depths[next..next + 2].fill(depth);
                next += 2;
            }
            if depths[index] > MOST_DEPTH {
                return Some("its tree is too deep");
            }
            if !(1..=CHUNK as u32).contains(&node.count) {
                return Some("`count` of a chunk is out of its range");
            }
            let sizes = [node.error, node.reach].into_iter().all(|size| size.is_finite() && size >= 0.0);
            let has_place = node.low.is_finite() && node.high.is_finite() && node.low.cmple(node.high).all();
            if !sizes || !has_place {
                return Some("`low`, `high`, `reach` or `error` of a chunk makes no sense");
            }
        }
        if !(self.space.origin.is_finite() && self.space.scale.is_finite() && self.space.scale > 0.0) {
            return Some("`space` makes no sense");
        }
        match (next == count, self.sh_degree <= MAX_SH_DEGREE) {
            (true, true) => None,
            (false, _) => Some("the number of its chunks is not that of a tree"),
            _ => Some("its spherical harmonics have a degree above 3"),
        }
    }
}

/// Writes the numbers of the chunks.
pub fn write(chunks: &[(Node, Gaussians)], out: &mut impl Write) -> io::Result<()> {
    for (_, gaussians) in chunks {
        for values in gaussians.values().into_array() {
            out.write_all(cast_slice(values))?;
        }
    }
    Ok(())
}

impl Levels {
    /// Of a tree whose numbers lie in the file from `begin` on, `bytes` in all.
    pub fn open(tree: Tree, path: &Path, (begin, bytes): (u64, u64)) -> Result<Self, String> {
        if let Some(fault) = tree.fault() {
            return Err(fault.to_owned());
        }
        if tree.bytes() != bytes {
            return Err(format!("has {bytes} bytes, its chunks need {}", tree.bytes()));
        }
        let file = File::open(path).map_err(|error| format!("can only be read from a file ({error})"))?;
        let Tree { space, sh_degree, nodes } = tree;
        let width = width((sh_degree as usize + 1).pow(2)) as u64;
        let (mut parents, mut starts, mut next) = (vec![0; nodes.len()], Vec::with_capacity(nodes.len()), 0);
        for (node, index) in nodes.iter().zip(0..) {
            starts.push(next);
            next += width * u64::from(node.count);
            node.children.into_iter().flatten().for_each(|child| parents[child as usize] = index);
        }
        Ok(Self { space, sh_degree, nodes, parents, starts, begin, file: Mutex::new(file), path: path.to_owned() })
    }

    /// Colours of spherical harmonics of a Gaussian.
    pub fn coefficients(&self) -> usize {
        (self.sh_degree as usize + 1).pow(2)
    }

    /// Chunks of full detail.
    pub fn leaves(&self) -> impl Iterator<Item = u32> + '_ {
        (0..).zip(&self.nodes).filter(|(_, node)| node.children.is_none()).map(|(index, _)| index)
    }

    /// Gaussians of the model.
    pub fn len(&self) -> usize {
        self.leaves().map(|leaf| self.nodes[leaf as usize].count as usize).sum()
    }

    /// Never: a model has a Gaussian.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Gaussians of the largest chunk.
    pub fn chunk(&self) -> usize {
        self.nodes.iter().map(|node| node.count as usize).max().unwrap_or(0)
    }

    /// The numbers of a chunk: those of each kind of parameter for all its Gaussians, in the order of [`PerGaussian`].
    ///
    /// # Errors
    /// The file cannot be read, or has numbers that are not finite.
    pub fn read(&self, node: u32) -> io::Result<Vec<f32>> {
        let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", self.path.display()));
        let count = self.nodes[node as usize].count as usize;
        let mut numbers = vec![0.0f32; width(self.coefficients()) * count];
        let mut file = self.file.lock().expect("levels file");
        file.seek(SeekFrom::Start(self.begin + 4 * self.starts[node as usize])).map_err(named)?;
        file.read_exact(cast_slice_mut(&mut numbers)).map_err(named)?;
        match numbers.iter().all(|v| v.is_finite()) {
            true => Ok(numbers),
            false => Err(named(io::Error::other(format!("chunk {node} is damaged; export or copy it again")))),
        }
    }

    /// The kinds of parameters in a chunk's numbers.
    pub(super) fn parts<'a>(&self, numbers: &'a [f32]) -> PerGaussian<&'a [f32]> {
        let count = numbers.len() / width(self.coefficients());
        let mut rest = numbers;
        PerGaussian::rows(self.coefficients()).map(|row| {
            let (part, after) = rest.split_at(row * count);
            rest = after;
            part
        })
    }

    /// The model in full detail.
    ///
    /// # Errors
    /// [`GpuError::Levels`] where the file cannot be read.
    pub fn whole(&self) -> Result<Gaussians, GpuError> {
        self.gaussians(self.leaves()).map_err(|error| GpuError::Levels(error.to_string()))
    }

    /// Some chunks as one model.
    ///
    /// # Errors
    /// As [`Levels::read`].
    pub fn gaussians(&self, nodes: impl Iterator<Item = u32>) -> io::Result<Gaussians> {
        let mut all = Gaussians { space: self.space, ..Gaussians::with_capacity(0, self.sh_degree) };
        for node in nodes {
            let numbers = self.read(node)?;
            let parts = self.parts(&numbers).map(<[f32]>::to_vec);
            all.append(Gaussians::from_values(self.space, self.sh_degree, parts));
        }
        Ok(all)
    }
}
