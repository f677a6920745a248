//! `.ksplat` files (github.com/mkkellogg/GaussianSplats3D); reading.
//!
//! A header of 4096 bytes, headers of 1024 bytes of the sections, then their data. A section has buckets of Gaussians that lie
//! in one cube each: the sizes of those that are not full, the middles of all cubes, and a row for each Gaussian with its
//! position, standard deviations, quaternion (w, x, y, z), colour of degree 0 and opacity as bytes, and the coefficients of
//! each higher degree, red, green and blue one after the other. Level 0 of the compression keeps floats; level 1 halves, and
//! positions in 16 bits within the cube; level 2 keeps the coefficients as bytes too.

use super::super::Gaussians;
use super::super::gaussians::coefficients;
use super::{MAX_SH_DEGREE, Steps, Writing, axes, quantise};
use half::f16;

pub(super) const ROW: super::Row = super::Row {
    name: "`.ksplat`",
    ending: ".ksplat",
    marks: &[],
    axes: axes::RDF,
    max_sh_degree: MAX_SH_DEGREE,
    steps: Steps { rotation: 0.0, sh: [1.0 / 255.0 / super::super::SH_C0, 0.0, 0.0, 0.0] },
    position_step: None,
    keeps_antialiased: false,
    place_of_offset: None,
    writing: Writing::Never,
    read: Some(|bytes, _| read(bytes)),
};

const HEADER: usize = 4096;
const SECTION_HEADER: usize = 1024;
/// Bytes of the middle of a cube.
const MIDDLE: usize = 12;
/// Largest coefficient of level 2 where the file does not say it.
const USUAL_RANGE: f32 = 1.5;

/// Bytes within a row.
struct Row {
    /// Level of the compression, 0 to 2.
    level: u16,
    degree: u32,
}

impl Row {
    /// Of a position, or of the standard deviations.
    fn triple(&self) -> usize {
        if self.level == 0 { 12 } else { 6 }
    }

    fn quaternion(&self) -> usize {
        if self.level == 0 { 16 } else { 8 }
    }

    /// Where the coefficients begin.
    fn head(&self) -> usize {
        2 * self.triple() + self.quaternion() + 4
    }

    fn coefficient(&self) -> usize {
        [4, 2, 1][usize::from(self.level)]
    }

    fn len(&self) -> usize {
        self.head() + 3 * (coefficients(self.degree) - 1) * self.coefficient()
    }
}

/// Little-endian numbers of a header.
struct Header<'a>(&'a [u8]);

impl Header<'_> {
    fn word(&self, at: usize) -> u32 {
        u32::from_le_bytes([self.0[at], self.0[at + 1], self.0[at + 2], self.0[at + 3]])
    }

    fn count(&self, at: usize) -> usize {
        self.word(at) as usize
    }

    fn short(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.0[at], self.0[at + 1]])
    }

    fn float(&self, at: usize) -> f32 {
        f32::from_bits(self.word(at))
    }
}

/// What the header of a section says, and its data.
struct Section<'a> {
    count: usize,
    row: Row,
    /// Gaussians of a full bucket, and how many of those there are.
    full: [usize; 2],
    /// Middle of each bucket's cube.
    middles: &'a [u8],
    /// How many Gaussians each bucket has that is not full.
    partial: &'a [u8],
    rows: &'a [u8],
    /// Half the side of a cube, and the steps that it has.
    half: f64,
    steps: f64,
}

/// Cuts bytes off the beginning.
fn cut<'a>(rest: &mut &'a [u8], length: Option<usize>) -> Result<&'a [u8], String> {
    let cut = length.and_then(|length| rest.split_at_checked(length));
    let (found, behind) = cut.ok_or_else(|| "it is truncated".to_owned())?;
    *rest = behind;
    Ok(found)
}

impl<'a> Section<'a> {
    /// # Errors
    /// What is wrong.
    fn read(header: &Header, level: u16, rest: &mut &'a [u8]) -> Result<Self, String> {
        let degree = u32::from(header.short(40));
        if degree > MAX_SH_DEGREE {
            return Err(format!("its spherical harmonics have degree {degree}; degrees 0 to {MAX_SH_DEGREE} are read"));
        }
        let [count, most, full, buckets] = [0, 4, 8, 12].map(|at| header.count(at));
        if count > most {
            return Err(format!("a section has {count} Gaussians and room for {most}"));
        }
        let [full_buckets, partial_buckets] = [32, 36].map(|at| header.count(at));
        if full_buckets.checked_add(partial_buckets).is_none_or(|counted| level > 0 && counted > buckets) {
            return Err(format!("a section fills {full_buckets} and {partial_buckets} of {buckets} buckets"));
        }
        let row = Row { level, degree };
        let bytes = usize::from(header.short(20));
        let partial = cut(rest, partial_buckets.checked_mul(4))?;
        let middles = cut(rest, bytes.checked_mul(buckets))?;
        if level > 0 && count > 0 && bytes != MIDDLE {
            return Err(format!("a bucket of a section takes {bytes} bytes where {MIDDLE} are needed"));
        }
        let rows = cut(rest, most.checked_mul(row.len()))?;
        let steps = if header.word(24) == 0 { 32_767 } else { header.word(24) };
        let half = f64::from(header.float(16)) / 2.0;
        Ok(Self { count, row, full: [full, full_buckets], middles, partial, rows, half, steps: f64::from(steps) })
    }

    /// The bucket of each Gaussian.
    fn buckets(&self) -> impl Iterator<Item = usize> {
        let [size, full] = self.full;
        let sizes = self.partial.chunks_exact(4).map(|size| Header(size).count(0));
        std::iter::repeat_n(size, full)
            .chain(sizes)
            .enumerate()
            .flat_map(|(bucket, size)| std::iter::repeat_n(bucket, size))
    }

    /// Appends its Gaussians; coefficients of level 2 lie in `range`.
    ///
    /// # Errors
    /// What is wrong.
    fn append(&self, range: [f32; 2], g: &mut Gaussians) -> Result<(), String> {
        let rows = self.rows.chunks_exact(self.row.len()).take(self.count);
        let mut buckets = self.buckets();
        for (index, row) in rows.enumerate() {
            let mean = if self.row.level == 0 {
                floats(row, 0)
            } else {
                let middle = buckets.next().and_then(|bucket| self.middles.get(MIDDLE * bucket..)?.get(..MIDDLE));
                let middle = middle.ok_or_else(|| format!("Gaussian {index} of a section is in no bucket"))?;
                self.within(row, floats(middle, 0))
            };
            g.means.push(mean);
            self.append_rest(row, range, g);
        }
        Ok(())
    }

    /// A position within the cube around `middle`.
    fn within(&self, row: &[u8], middle: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| {
            let steps = f64::from(Header(row).short(2 * axis)) - self.steps;
            (f64::from(middle[axis]) + steps * self.half / self.steps) as f32
        })
    }

    fn append_rest(&self, row: &[u8], [low, high]: [f32; 2], g: &mut Gaussians) {
        let number = |at: usize, index: usize| -> f32 {
            match self.row.level {
                0 => Header(row).float(at + 4 * index),
                _ => f16::from_bits(Header(row).short(at + 2 * index)).to_f32(),
            }
        };
        let (scales, quaternion) = (self.row.triple(), 2 * self.row.triple());
        g.log_scales.push([0, 1, 2].map(|axis| quantise::log_scale(number(scales, axis))));
        g.rotations.push(quantise::read_quaternion([0, 1, 2, 3].map(|part| number(quaternion, part))));
        let head = self.row.head();
        let color = &row[head - 4..head];
        g.opacity_logits.push(quantise::logit_of_byte(color[3]));
        let first = g.sh.len();
        g.sh.resize(first + 3 * g.sh_coefficients(), 0.0);
        let sh = &mut g.sh[first..];
        (0..3).for_each(|channel| sh[channel] = quantise::dc(f64::from(color[channel]) / 255.0));
        let mut index = 0;
        for degree in 1..=self.row.degree as usize {
            for channel in 0..3 {
                for coefficient in degree * degree..(degree + 1) * (degree + 1) {
                    sh[3 * coefficient + channel] = match self.row.level {
                        2 => low + f32::from(row[head + index]) / 255.0 * (high - low),
                        _ => number(head, index),
                    };
                    index += 1;
                }
            }
        }
    }
}

fn floats(bytes: &[u8], at: usize) -> [f32; 3] {
    [0, 1, 2].map(|axis| Header(bytes).float(at + 4 * axis))
}

/// Reads a whole file.
///
/// # Errors
/// What is wrong.
fn read(bytes: &[u8]) -> Result<Gaussians, String> {
    let mut rest = bytes;
    let header = Header(cut(&mut rest, Some(HEADER))?);
    let [major, minor] = [header.0[0], header.0[1]];
    if major != 0 || minor < 1 {
        return Err(format!("it has version {major}.{minor} of the format; version 0.1 is read"));
    }
    let level = header.short(20);
    if level > 2 {
        return Err(format!("it has the compression level {level}; levels 0 to 2 are read"));
    }
    let sections = cut(&mut rest, header.count(4).checked_mul(SECTION_HEADER))?;
    let sections: Vec<Section> = sections
        .chunks_exact(SECTION_HEADER)
        .map(|section| Section::read(&Header(section), level, &mut rest))
        .collect::<Result<_, _>>()?;
    // The rows of all of them are in the file.
    let found: usize = sections.iter().map(|section| section.count).sum();
    let promised = header.count(16);
    if found != promised {
        return Err(format!("it promises {promised} Gaussians, its sections have {found}"));
    }
    let usual = |value: f32, usual: f32| if value == 0.0 { usual } else { value };
    let range = [usual(header.float(36), -USUAL_RANGE), usual(header.float(40), USUAL_RANGE)];
    let degree = sections.iter().filter(|section| section.count > 0).map(|section| section.row.degree).max();
    let mut g = Gaussians::with_capacity(found, degree.unwrap_or_default());
    sections.iter().try_for_each(|section| section.append(range, &mut g))?;
    Ok(g)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::formats::tests::read_named;

    /// A file of one section by hand: `rows` of a level and degree, the sizes of buckets that are not full, and middles.
    fn file(level: u16, degree: u16, rows: &[Vec<u8>], partial: &[u32], middles: &[[f32; 3]]) -> Vec<u8> {
        let mut file = vec![0; HEADER + SECTION_HEADER];
        let mut set = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
        let count = (rows.len() as u32).to_le_bytes();
        set(1, &[1]);
        set(4, &1_u32.to_le_bytes());
        set(16, &count);
        set(20, &level.to_le_bytes());
        set(36, &(-2.0_f32).to_le_bytes());
        set(40, &2.0_f32.to_le_bytes());
        let section = HEADER;
        set(section, &count);
        set(section + 4, &count);
        // Two Gaussians fill a bucket, whose cube has sides of 5.
        set(section + 8, &2_u32.to_le_bytes());
        set(section + 12, &(middles.len() as u32).to_le_bytes());
        set(section + 16, &5.0_f32.to_le_bytes());
        set(section + 20, &12_u16.to_le_bytes());
        set(section + 32, &((middles.len() - partial.len()) as u32).to_le_bytes());
        set(section + 36, &(partial.len() as u32).to_le_bytes());
        set(section + 40, &degree.to_le_bytes());
        file.extend(partial.iter().flat_map(|size| size.to_le_bytes()));
        file.extend(middles.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        file.extend(rows.concat());
        file
    }

    fn halves(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect()
    }

    fn row_1(x: u16) -> Vec<u8> {
        let position = [x, 32_767, 32_767].map(u16::to_le_bytes).concat();
        let rest = halves(&[1.0, 0.5, 0.25, 1.0, 0.0, 0.0, 0.0]);
        let harmonics = halves(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]);
        [position, rest, vec![255, 0, 128, 255], harmonics].concat()
    }

    #[test]
    fn level_1_has_buckets() {
        let middles = [[1.0, 2.0, 3.0], [10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]];
        // A full bucket, one with one Gaussian, one with two.
        let rows = [0, 65_534, 32_767, 32_767, 0].map(row_1);
        let g = read_named(&file(1, 1, &rows, &[1, 2], &middles), "a.ksplat").unwrap();
        let expected = [[-1.5, 2.0, 3.0], [3.5, 2.0, 3.0], [10.0, 0.0, 0.0], [-10.0, 0.0, 0.0], [-12.5, 0.0, 0.0]];
        assert_eq!(g.means, expected);
        assert_eq!(g.log_scales[0], [1.0_f32, 0.5, 0.25].map(f32::ln));
        assert_eq!((g.sh_degree, g.rotations[4]), (1, [1.0, 0.0, 0.0, 0.0]));
        assert!(g.opacity_logits[0] > 6.0);
        // Red has the first three coefficients, then come green and blue.
        let expected = [0.1, 0.4, 0.7, 0.2, 0.5, 0.8, 0.3, 0.6, 0.9];
        assert!(g.sh[3..12].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{:?}", g.sh);
        assert!((quantise::color(g.sh[0]) - 1.0).abs() < 1e-6 && quantise::color(g.sh[1]).abs() < 1e-6);
    }

    #[test]
    fn levels_0_and_2() {
        let floats = [1e3_f32, -2.0, 3.0, 0.5, 0.5, 0.0, 0.0, 2.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
        let g =
            read_named(&file(0, 0, &[[floats, vec![1, 2, 3, 128]].concat()], &[], &[[0.0; 3]]), "a.ksplat").unwrap();
        assert_eq!((g.means[0], g.rotations[0], g.sh_degree), ([1e3, -2.0, 3.0], [0.0, 1.0, 0.0, 0.0], 0));
        let mut row = row_1(32_767);
        row.truncate(24);
        row.extend([0, 255, 51].repeat(3).into_iter().chain([255; 15]));
        let g = read_named(&file(2, 2, &[row], &[1], &[[0.0; 3]]), "a.ksplat").unwrap();
        assert_eq!(g.sh_degree, 2);
        let expected = [[-2.0; 3], [2.0; 3], [-1.2; 3]].concat();
        assert!(g.sh[3..12].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6) && g.sh[12..] == [2.0; 15]);
    }

    #[test]
    fn files_that_make_no_sense() {
        let whole = file(1, 1, &[row_1(0), row_1(1)], &[], &[[0.0; 3]]);
        read_named(&whole, "a.ksplat").unwrap();
        let refused = |at: usize, bytes: &[u8]| {
            let mut file = whole.clone();
            file[at..at + bytes.len()].copy_from_slice(bytes);
            read_named(&file, "a.ksplat").unwrap_err().to_string()
        };
        let cases: [(usize, &[u8], &str); 11] = [
            (0, &[1], "version 1.1"),
            (1, &[0], "version 0.0"),
            (20, &[3], "compression level 3"),
            (4, &[0xff; 4], "truncated"),
            (16, &[9], "promises 9 Gaussians, its sections have 2"),
            (HEADER, &[9], "9 Gaussians and room for 2"),
            (HEADER + 4, &[0xff; 4], "truncated"),
            (HEADER + 20, &[0], "takes 0 bytes"),
            (HEADER + 32, &[0], "in no bucket"),
            (HEADER + 32, &[2], "fills 2 and 0 of 1 buckets"),
            (HEADER + 40, &[4], "degree 4"),
        ];
        for (at, bytes, expected) in cases {
            let text = refused(at, bytes);
            assert!(text.contains(expected) && text.contains("a.ksplat"), "{at}: {text}");
        }
        for end in 0..whole.len() {
            assert!(read_named(&whole[..end], "a.ksplat").is_err(), "{end}");
        }
    }
}
