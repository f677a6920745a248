//! Camera parameters of RealityCapture and RealityScan: the export "Internal/External camera parameters", a CSV file with one
//! photo a line, `#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2`.
//!
//! - The camera stands at `(x, y, alt)`. Angles are in degrees. With all three 0 it looks straight down with the north, +y, at
//!   the top; `heading` turns it clockwise as seen from above, `pitch` raises its view to the horizon at 90, `roll` turns it around the height of the photo:
//!   world from camera (x right, y up, z backward) is `Rz(-heading) Rx(pitch) Ry(roll)`.
//! - `f` is for a film of 36 mm along the larger side, `px` and `py` are shares of the larger side, from the photo's centre.
//! - `k1 .. k4` are Brown's factors of `r^2 .. r^8`, `t1` and `t2` OpenCV's p1 and p2.
//!
//! The export's template may leave out intrinsics other than `f`; they are then 0. The size of a photo is that of its file.

use super::decode::photo_size;
use super::error::{DatasetError, read_bytes, without_mark};
use super::format::not_a_scene;
use super::info::Beside;
use super::lens::{Distortion, Lens, Pose, Projection};
use super::masks::{MaskFinder, is_mask};
use super::names::{Inside, Photo, PhotoFolders, RelativeTo, photos_below, photos_in};
use super::photos::{AbsoluteNames, ListedPhoto};
use super::{LoadOptions, Loader, Scene, SceneFile, SceneKind};
use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Width of the film to which `f` refers.
const FILM: f64 = 36.0;

/// The first column; the file begins with it.
const NAME: &str = "#name";
/// Columns that every file has, and those that may be absent.
const POSE: [&str; 7] = ["x", "y", "alt", "heading", "pitch", "roll", "f"];
const LENS: [&str; 8] = ["px", "py", "k1", "k2", "k3", "k4", "t1", "t2"];

/// Most bytes of comments above the column names.
const HEADER_BYTES: u64 = 4096;

/// Where a column is, by its place in [`POSE`] and [`LENS`].
struct Columns {
    pose: [usize; 7],
    lens: [Option<usize>; 8],
}

/// A line of the file.
struct Row {
    line: usize,
    name: String,
    pose: [f64; 7],
    lens: [f64; 8],
}

/// Whether a file begins as such a list does.
fn is_listing(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEADER_BYTES).read_to_end(&mut start));
    let text = String::from_utf8_lossy(without_mark(&start));
    // A line such as `#cameras 35` may stand above.
    let comments = text.lines().map(str::trim).take_while(|line| line.is_empty() || line.starts_with('#'));
    let is_header = |line: &str| line.split(',').next().is_some_and(|first| first.trim() == NAME);
    read.is_ok() && comments.into_iter().any(is_header)
}

/// The lists of a folder, or the file itself.
fn listings(scene: &Path) -> Vec<PathBuf> {
    let is_csv = |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"));
    let entries = std::fs::read_dir(scene).into_iter().flatten().flatten().map(|entry| entry.path());
    let files = if scene.is_file() { vec![scene.to_owned()] } else { entries.collect() };
    let mut listings: Vec<PathBuf> =
        files.into_iter().filter(|path| is_csv(path) && path.is_file() && is_listing(path)).collect();
    listings.sort();
    listings
}

fn listing(scene: &Path) -> Result<PathBuf, DatasetError> {
    let mut listings = listings(scene);
    match (listings.pop(), listings.is_empty()) {
        (Some(listing), true) => Ok(listing),
        (Some(last), false) => {
            let all = listings.iter().chain([&last]);
            let names = all.filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
            Err(DatasetError::SeveralListings { path: scene.to_owned(), files: names.collect() })
        }
        (None, _) => Err(not_a_scene(scene)),
    }
}

impl Columns {
    fn find(path: &Path, line: usize, header: &[String]) -> Result<Columns, DatasetError> {
        let place = |name: &str| header.iter().position(|column| column.eq_ignore_ascii_case(name));
        let missing: Vec<&str> = POSE.into_iter().filter(|name| place(name).is_none()).collect();
        if !missing.is_empty() {
            let problem = format!(
                "there is no column {}; export `Internal/External camera parameters`, which has all of them",
                missing.join(", ")
            );
            return Err(DatasetError::line(path, line, problem));
        }
        Ok(Columns { pose: POSE.map(|name| place(name).unwrap_or_default()), lens: LENS.map(place) })
    }

    fn row(&self, path: &Path, line: usize, record: &[String]) -> Result<Row, DatasetError> {
        let refuse = |problem: String| DatasetError::line(path, line, problem);
        let number = |name: &str, column: usize| {
            let text = record.get(column).map(String::as_str).filter(|text| !text.is_empty());
            let text = text.ok_or_else(|| refuse(format!("{name} is missing")))?;
            let value: Option<f64> = text.parse().ok().filter(|value: &f64| value.is_finite());
            value.ok_or_else(|| refuse(format!("{name} `{text}` is not a finite number")))
        };
        let name = record.first().cloned().unwrap_or_default();
        if name.is_empty() {
            return Err(refuse("the name is missing".to_owned()));
        }
        let mut row = Row { line, name, pose: [0.0; 7], lens: [0.0; 8] };
        for (value, (name, column)) in row.pose.iter_mut().zip(POSE.iter().zip(self.pose)) {
            *value = number(name, column)?;
        }
        for (value, (name, column)) in row.lens.iter_mut().zip(LENS.iter().zip(self.lens)) {
            *value = column.map_or(Ok(0.0), |column| number(name, column))?;
        }
        Ok(row)
    }
}

/// The fields of a line; a comma inside double quotes does not separate fields. RealityCapture writes no quotes,
/// spreadsheets do.
fn fields(line: &str) -> Vec<String> {
    let mut quoted = false;
    let parts = line.split(|c: char| {
        quoted ^= c == '"';
        c == ',' && !quoted
    });
    parts.map(|part| part.trim().trim_matches('"').to_owned()).collect()
}

/// The lines of a file.
fn rows(path: &Path, bytes: &[u8]) -> Result<Vec<Row>, DatasetError> {
    let mut columns = None;
    let mut rows = Vec::new();
    for (line, bytes) in (1..).zip(without_mark(bytes).split(|byte| *byte == b'\n')) {
        let text = std::str::from_utf8(bytes);
        let text = text.map_err(|_| DatasetError::line(path, line, "the line is not UTF-8 text"))?;
        let record = fields(text);
        match &columns {
            _ if text.trim().is_empty() => {}
            None if record[0] == NAME => columns = Some(Columns::find(path, line, &record)?),
            None => {}
            Some(columns) => rows.push(columns.row(path, line, &record)?),
        }
    }
    match columns {
        Some(_) => Ok(rows),
        None => Err(DatasetError::line(path, 1, format!("there is no line that begins with `{NAME}`"))),
    }
}

impl Row {
    fn pose(&self) -> Result<Pose, String> {
        let [x, y, alt, heading, pitch, roll, _] = self.pose;
        let [heading, pitch, roll] = [heading, pitch, roll].map(f64::to_radians);
        let turn = DMat3::from_rotation_z(-heading) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(roll);
        Pose::from_opengl_axes(turn, DVec3::new(x, y, alt))
    }

    /// The lens, for a photo of this size.
    fn lens(&self, (width, height): (u32, u32)) -> Result<Lens, String> {
        let size = DVec2::new(f64::from(width), f64::from(height));
        let larger = size.max_element();
        let [px, py, k1, k2, k3, k4, t1, t2] = self.lens;
        let [.., f] = self.pose;
        let lens = Lens {
            width,
            height,
            focal: DVec2::splat(f / FILM * larger),
            principal: size / 2.0 + DVec2::new(px, py) * larger,
            distortion: Distortion {
                projection: Projection::Perspective,
                radial: [k1, k2, k3, k4],
                tangential: [t1, t2],
                ..Distortion::default()
            },
        };
        lens.problem().map_or(Ok(lens), Err)
    }
}

/// Checks the contents of a camera list, and counts its photos; `path` is for messages.
fn check(path: &Path, bytes: &[u8]) -> Result<usize, DatasetError> {
    let rows = rows(path, bytes)?;
    for row in &rows {
        row.pose().map_err(|problem| DatasetError::line(path, row.line, problem))?;
    }
    Ok(rows.len())
}

/// Photos by file name. The list has file names only, even for photos in sub-folders.
struct ByFileName {
    /// Keys are names with and without extension; the value is none if several photos have the name.
    photos: BTreeMap<String, Option<PathBuf>>,
}

impl ByFileName {
    fn new(folders: &PhotoFolders, root: &Path) -> ByFileName {
        let main = folders.main();
        let found = if main.is_dir() { photos_below(&main) } else { photos_in(root) };
        let mut photos = BTreeMap::new();
        for path in found.into_iter().filter(|path| !is_mask(path)) {
            let names = [path.file_name(), path.file_stem()].into_iter().flatten();
            for name in names.map(|name| name.to_string_lossy().into_owned()) {
                photos.entry(name).and_modify(|photo| *photo = None).or_insert_with(|| Some(path.clone()));
            }
        }
        ByFileName { photos }
    }

    fn find(&self, name: &str) -> Option<PathBuf> {
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        [name, stem].into_iter().find_map(|name| self.photos.get(name)?.clone())
    }
}

/// A list of cameras, or a folder with one.
#[derive(Debug)]
pub(crate) struct RealityCapture;

impl Loader for RealityCapture {
    fn shown_by(&self) -> &str {
        "list of cameras (.csv, RealityCapture)"
    }

    fn is_scene(&self, path: &Path) -> bool {
        !listings(path).is_empty()
    }

    fn files(&self) -> &'static [SceneFile] {
        &[SceneFile { name: "cameras.csv", check }]
    }

    /// Reads the list and finds its photos.
    fn read(&self, scene: &Path, options: &LoadOptions) -> Result<Scene, DatasetError> {
        let listing = listing(scene)?;
        let root = super::root(&listing).to_owned();
        let folders = PhotoFolders::new(&root, RelativeTo::Photos, options);
        if let Some(path) = folders.absent() {
            return Err(DatasetError::NoPhotoFolder { path });
        }
        let elsewhere = ByFileName::new(&folders, &root);
        let (mut frames, mut missing, mut absolute) = (Vec::new(), Vec::new(), AbsoluteNames::default());
        let masks = MaskFinder::new(&root);
        for row in rows(&listing, &read_bytes(&listing)?)? {
            let refuse = || DatasetError::ImageName { path: listing.clone(), name: row.name.clone() };
            let (inside, photo) = folders.resolve(&row.name).ok_or_else(refuse)?;
            let pose = row.pose().map_err(|problem| DatasetError::line(&listing, row.line, problem))?;
            absolute.add(&root, &row.name, &inside);
            let Inside { name, .. } = inside;
            let (photo, prescaled) = match (photo, elsewhere.find(&name)) {
                (Photo::Found(photo, prescaled), _) => (photo, prescaled),
                (Photo::Missing(_), Some(photo)) => (photo, folders.is_reduced()),
                (Photo::Missing(path), None) => {
                    missing.push(path);
                    continue;
                }
            };
            let camera = format!("line {} (`{name}`)", row.line);
            let lens = row.lens(photo_size(&photo)?);
            let lens = lens.map_err(|problem| DatasetError::Intrinsics { path: listing.clone(), camera, problem })?;
            let mask = masks.find(&name, &photo);
            frames.push(ListedPhoto { name, photo, mask, lens, pose, prescaled, key: None });
        }
        let main = folders.main();
        let beside = if main.is_dir() { Beside::Below(main) } else { Beside::SameFolders };
        let kind = SceneKind::new("reality_capture", "RealityCapture");
        Ok(Scene {
            point_files: clouds(&root),
            missing,
            beside,
            notes: absolute.note().into_iter().collect(),
            ..Scene::new(kind, listing, frames)
        })
    }
}

/// The point clouds beside the list, by name.
fn clouds(root: &Path) -> Vec<PathBuf> {
    let is_ply = |path: &PathBuf| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ply"));
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut clouds: Vec<PathBuf> = entries.filter(is_ply).collect();
    clouds.sort();
    clouds
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";

    fn row_of(line: &str) -> Row {
        rows(Path::new("a.csv"), format!("{HEADER}\n{line}\n").as_bytes()).unwrap().remove(0)
    }

    /// Axes of the camera in the world from compass and tilt, without matrices: right, up, forward.
    fn axes([heading, pitch, roll]: [f64; 3]) -> [DVec3; 3] {
        let [heading, pitch, roll] = [heading, pitch, roll].map(f64::to_radians);
        let forward = DVec3::new(heading.sin() * pitch.sin(), heading.cos() * pitch.sin(), -pitch.cos());
        let right = DVec3::new(heading.cos(), -heading.sin(), 0.0);
        let up = right.cross(forward);
        [right * roll.cos() + forward * roll.sin(), up, forward * roll.cos() - right * roll.sin()]
    }

    #[test]
    fn points_project_where_the_export_says() {
        let angles = [[0.0, 0.0, 0.0], [90.0, 90.0, 0.0], [170.35, 85.19, -22.75], [-33.0, 40.0, 12.5]];
        let center = DVec3::new(44.5, 138.8, 6.8);
        let ([f, px, py], [k1, k2, k3, k4, t1, t2]) =
            ([14.24, -9.5e-3, 2.4e-2], [0.031, -0.04, 0.018, -0.002, 0.003, -0.004]);
        for (size, angles) in [(4000, 3000), (3000, 4000)].into_iter().flat_map(|size| angles.map(|a| (size, a))) {
            let [h, p, r] = angles;
            let row = row_of(&format!(
                "a.jpg,{},{},{},{h},{p},{r},{f},{px},{py},{k1},{k2},{k3},{k4},{t1},{t2}",
                center.x, center.y, center.z
            ));
            let (pose, lens) = (row.pose().unwrap(), row.lens(size).unwrap());
            let [right, up, forward] = axes(angles);
            for (x, y, depth) in [(0.0, 0.0, 3.0), (0.4, -0.3, 2.0), (-0.5, 0.1, 7.0), (0.2, 0.45, 50.0)] {
                let point = center + (right * x - up * y + forward) * depth;
                let r2: f64 = x * x + y * y;
                let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3) + k4 * r2.powi(4);
                let bent = DVec2::new(
                    x * radial + 2.0 * t1 * x * y + t2 * (r2 + 2.0 * x * x),
                    y * radial + 2.0 * t2 * x * y + t1 * (r2 + 2.0 * y * y),
                );
                let (width, height) = (f64::from(size.0), f64::from(size.1));
                let expected =
                    bent * (f * 4000.0 / 36.0) + DVec2::new(width / 2.0 + px * 4000.0, height / 2.0 + py * 4000.0);
                let view = pose.view_from_world * point + pose.translation;
                let found = lens.distortion.distort(view.truncate() / view.z) * lens.focal + lens.principal;
                assert!((view.z - depth).abs() < 1e-9, "{angles:?}: depth {} for {depth}", view.z);
                assert!(found.distance(expected) < 1e-6, "{angles:?} {size:?}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn level_cameras_look_along_their_heading() {
        let looks = |heading: f64| {
            let pose = row_of(&format!("a.jpg,0,0,0,{heading},90,0,20,0,0,0,0,0,0,0,0")).pose().unwrap();
            pose.view_from_world.transpose() * DVec3::Z
        };
        for (heading, forward) in [(0.0, DVec3::Y), (90.0, DVec3::X), (180.0, -DVec3::Y), (270.0, -DVec3::X)] {
            assert!(looks(heading).distance(forward) < 1e-12, "{heading}: {}", looks(heading));
        }
    }

    #[test]
    fn columns_may_stand_anywhere_and_lens_columns_may_be_absent() {
        let text = "\u{feff}#cameras 1\r\n\r\n#name, F ,x,y,alt,roll,pitch,heading\r\n\"a, b.jpg\",20,1,2,3,4,5,6\r\n";
        let row = rows(Path::new("a.csv"), text.as_bytes()).unwrap().remove(0);
        assert_eq!((row.name.as_str(), row.pose), ("a, b.jpg", [1.0, 2.0, 3.0, 6.0, 5.0, 4.0, 20.0]));
        assert_eq!(row.lens, [0.0; 8]);
    }
}
