//! From photos or a video to a scene with camera poses, by ffmpeg and COLMAP.

pub mod colmap;
mod photos;
mod record;
pub mod tool;
mod upright;
mod video;

use anyhow::{Context, Result, bail};
use colmap::{Cameras, Colmap, Matching, Origin, Quality, WORK};
use ibgs_core::dataset::{self, has_extension, picture_extensions};
use ibgs_core::files::is_same;
use ibgs_core::output::Existing;
use ibgs_core::progress::Progress;
use ibgs_core::{counted, first_of};
use photos::{left_out, photos_below, unread_note};
pub use record::Request;
use record::{Contents, Record, Step};
use std::fs;
use std::path::{Path, PathBuf};
use tool::Tool;

/// Fewest photos that have poses.
const FEWEST: usize = 3;
/// Photos that are named one by one.
const NAMED: usize = 5;
const VIDEOS: [&str; 10] = ["mp4", "mov", "m4v", "avi", "mkv", "webm", "mts", "m2ts", "mpg", "wmv"];

/// What was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// Photos in the scene.
    pub photos: usize,
    /// Their poses.
    pub quality: Quality,
    /// Photos without a pose, by their paths inside the scene.
    pub unposed: Vec<String>,
}

/// A scene in the making.
pub struct Preparation<'a> {
    scene: PathBuf,
    record: Record,
    progress: &'a dyn Progress,
}

impl<'a> Preparation<'a> {
    /// Begins a scene, or continues one that was begun with the same request. Nothing is written where that fails.
    ///
    /// # Errors
    /// The folder holds something else, or cannot be written.
    pub fn begin(scene: &Path, request: Request, existing: Existing, progress: &'a dyn Progress) -> Result<Self> {
        let photos = photos_of(&request.inputs, scene)?;
        check_inputs(&request.inputs, &photos, scene)?;
        let images = scene.join("images");
        let mut record = Record::new(request, Contents::of(&photos));
        let own_photos = |record: &Record| record.request.inputs.iter().any(|input| is_same(input, &images));
        match Record::read(scene)? {
            Some(earlier) if existing == Existing::Keep && earlier.continues(&record) => record = earlier,
            Some(_) if existing == Existing::Keep => bail!(
                "{} was begun with other photos or options; to begin anew, add `--overwrite` to `ibgs prepare`, or choose another \
                 folder",
                scene.display()
            ),
            Some(earlier) if own_photos(&earlier) && !own_photos(&record) => {
                bail!("{} holds photos that were there before; choose another folder", images.display())
            }
            // Photos of the user's own stay.
            Some(_) if own_photos(&record) => clear(scene, &["sparse", WORK])?,
            Some(_) => clear(scene, &["sparse", WORK, "images"])?,
            None if has_poses(scene) => {
                bail!("{} has camera poses already: train on it, or choose another folder", scene.display())
            }
            None if images.exists() && !own_photos(&record) => {
                bail!("{} is there already; name it as the input, or choose another folder", images.display())
            }
            None => {}
        }
        fs::create_dir_all(scene).with_context(|| format!("cannot create {}", scene.display()))?;
        record.save(scene)?;
        Ok(Self { scene: scene.to_owned(), record, progress })
    }

    fn done(&mut self, step: Step) -> Result<()> {
        self.record.done = step;
        self.record.save(&self.scene)
    }

    /// Does what is left. `note` receives sentences for the user.
    ///
    /// # Errors
    /// A program is missing or fails, no photos, no poses.
    pub fn run(mut self, colmap: &Colmap, ffmpeg: &Tool, note: &mut dyn FnMut(String)) -> Result<Prepared> {
        if self.record.done < Step::Photos {
            self.collect(ffmpeg, note)?;
            self.done(Step::Photos)?;
            self.unreadable()?.into_iter().for_each(&mut *note);
        }
        let images = self.scene.join("images");
        let photos = photos_below(&images)?;
        let (count, progress) = (photos.len(), self.progress);
        if self.record.done < Step::Features {
            note(format!("finding features in {count} photos"));
            colmap.features(&self.record.request.camera_model, self.cameras(&photos), count, progress)?;
            self.done(Step::Features)?;
        }
        if self.record.done < Step::Matches {
            let are_videos = self.record.request.inputs.iter().all(|input| is_video(input));
            let origin = if are_videos { Origin::Videos } else { Origin::Photos };
            let matching = self.record.request.matching.decided(count, origin);
            let what = if matching == Matching::Sequential { "neighbours" } else { "each photo with each other one" };
            note(format!("comparing {what}; this takes longest"));
            colmap.matches(matching, count, progress)?;
            self.done(Step::Matches)?;
        }
        if self.record.done < Step::Poses {
            colmap.map(count, progress, note)?;
            self.done(Step::Poses)?;
        }
        let quality = colmap.choose()?;
        let unposed =
            dataset::inspect(&self.scene).map_err(|error| anyhow::anyhow!("COLMAP's model: {error}"))?.unposed;
        Ok(Prepared { photos: count, quality, unposed })
    }

    /// Brings all photos into `images/`.
    fn collect(&self, ffmpeg: &Tool, note: &mut dyn FnMut(String)) -> Result<()> {
        let images = self.scene.join("images");
        let Request { inputs, frames, .. } = &self.record.request;
        for (i, (input, photos)) in inputs.iter().zip(photos_of(inputs, &self.scene)?).enumerate() {
            if is_same(input, &images) {
                photos::notes_on_own(&images, &photos)?.into_iter().for_each(&mut *note);
                continue;
            }
            let part = if inputs.len() == 1 { PathBuf::new() } else { part_name(inputs, i).into() };
            let folder = images.join(&part);
            fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
            if input.is_dir() {
                photos::copy(input, &photos, &folder, self.progress)?.into_iter().for_each(&mut *note);
                photos::copy_masks(input, &self.scene.join("masks").join(&part))?.into_iter().for_each(&mut *note);
            } else {
                let [chosen, all] = video::extract(ffmpeg, input, &folder, *frames)?;
                note(format!("{}: {chosen} of {all} frames chosen", input.display()));
            }
        }
        Ok(())
    }

    /// Names the photos that cannot be read, where there are any; COLMAP passes over them.
    fn unreadable(&self) -> Result<Option<String>> {
        let images = self.scene.join("images");
        let photos = photos_below(&images)?;
        let names: Vec<_> = photos
            .iter()
            .filter(|path| dataset::photo_size(path).is_err())
            .map(|path| path.strip_prefix(&images).unwrap_or(path).display().to_string())
            .collect();
        let count = names.len();
        Ok((count > 0).then(|| format!("{count} of {} photos cannot be read: {}", photos.len(), listed(&names))))
    }

    /// Photos of one size from one input are of one camera.
    fn cameras(&self, photos: &[PathBuf]) -> Cameras {
        // One that cannot be read says nothing of the others.
        let mut sizes = photos.iter().filter_map(|path| dataset::photo_size(path).ok());
        let is_one_size = sizes.next().is_some_and(|first| sizes.all(|size| size == first));
        match (is_one_size, self.record.request.inputs.len()) {
            (true, 1) => Cameras::One,
            (true, _) => Cameras::PerFolder,
            (false, _) => Cameras::ByMetadata,
        }
    }
}

/// Whether there are photos enough, and none of another scene.
fn check_inputs(inputs: &[PathBuf], found: &[Vec<PathBuf>], scene: &Path) -> Result<()> {
    let mut photos = 0;
    for (input, found) in inputs.iter().zip(found) {
        if has_poses(input) && !is_same(input, scene) {
            bail!(
                "{} has camera poses already: `ibgs train {0}`; to estimate others, name the folder of its photos",
                input.display()
            );
        }
        if input.is_dir() {
            photos += found.len();
        } else if is_video(input) {
            photos += FEWEST;
        } else {
            bail!(
                "{} is neither a folder of photos nor a video ({})",
                input.display(),
                VIDEOS.map(|extension| format!(".{extension}")).join(", ")
            );
        }
    }
    if photos < FEWEST {
        let [first, ..] = inputs else { bail!("there are no photos") };
        let unread = inputs.iter().find_map(|input| unread_note(input, &left_out(input).unwrap_or_default()));
        let unread = unread.map_or_else(String::new, |note| format!("; {note}"));
        bail!(
            "{} has {} ({}); poses need at least {FEWEST}, good ones 30 or more{unread}",
            first.display(),
            counted(photos, "photo"),
            known_extensions()
        );
    }
    Ok(())
}

/// Whether a folder is a scene. A preparation that failed leaves `sparse` empty.
fn has_poses(folder: &Path) -> bool {
    fs::read_dir(folder.join("sparse")).is_ok_and(|mut entries| entries.next().is_some())
}

/// The photos of each input, or its video, without the copies that the scene has of them.
///
/// # Errors
/// An input lies within the copies.
fn photos_of(inputs: &[PathBuf], scene: &Path) -> Result<Vec<Vec<PathBuf>>> {
    // Also of a folder that is not there yet.
    let canonical = |path: &Path| match path.canonicalize() {
        Ok(path) => Ok(path),
        Err(_) => std::path::absolute(path).with_context(|| format!("cannot find {}", path.display())),
    };
    let scene = canonical(scene)?;
    let images = canonical(&scene.join("images"))?;
    let photos = |input: &PathBuf| -> Result<Vec<PathBuf>> {
        if !input.is_dir() {
            return Ok(vec![input.clone()]);
        }
        let folder = canonical(input)?;
        if folder.starts_with(&images) && folder != images {
            bail!("{} lies in {}; name that folder, or choose another scene", input.display(), images.display());
        }
        let left_out = if folder == images {
            // What the other inputs were copied to.
            let others = (0..inputs.len()).filter(|&i| !is_same(&inputs[i], &images));
            others.map(|i| images.join(part_name(inputs, i))).collect()
        } else if scene.starts_with(&folder) && scene != folder {
            vec![scene.clone()]
        } else {
            vec![images.clone()]
        };
        let below = |path: &PathBuf| path.strip_prefix(input).map_or(path.clone(), |rest| folder.join(rest));
        let mut photos = photos_below(input)?;
        photos.retain(|path| !left_out.iter().any(|folder| below(path).starts_with(folder)));
        Ok(photos)
    };
    inputs.iter().map(photos).collect()
}

/// Whether one of the inputs needs ffmpeg.
pub fn is_video(path: &Path) -> bool {
    path.is_file() && has_extension(path, &VIDEOS)
}

/// Where photos or a video without poses are: the path itself, or the folder `images` in it. None where there are none.
pub fn inputs_in(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return is_video(path).then(|| path.to_owned());
    }
    let has_photos = |folder: &Path| {
        fs::read_dir(folder).is_ok_and(|mut entries| entries.any(|entry| entry.is_ok_and(|e| is_photo(&e.path()))))
    };
    [path.to_owned(), path.join("images")].into_iter().find(|folder| has_photos(folder))
}

/// The scene that is made of an input where no other is named: beside it, with its name and `-scene`. A folder `images` has the
/// name of the folder around it.
///
/// # Errors
/// The input is not there.
pub fn scene_beside(input: &Path) -> Result<PathBuf> {
    let full = input.canonicalize().with_context(|| format!("cannot find {}", input.display()))?;
    // The path as it was given reads better, where it ends with a name.
    let mut named = if input.file_name().is_some() { input } else { &full };
    if named.is_dir() && named.ends_with("images") {
        named = named.parent().filter(|parent| parent.file_name().is_some()).unwrap_or(named);
    }
    let stem = if named.is_dir() { named.file_name() } else { named.file_stem() };
    let mut name = stem.unwrap_or_else(|| "photos".as_ref()).to_owned();
    name.push("-scene");
    Ok(named.with_file_name(name))
}

/// Whether a scene is complete and was made of these inputs, which have not changed since; with whatever options.
///
/// # Errors
/// Inputs or the scene cannot be read.
pub fn is_complete(scene: &Path, inputs: &[PathBuf]) -> Result<bool> {
    let Some(record) = Record::read(scene)? else { return Ok(false) };
    Ok(has_poses(scene) && record.is_complete(inputs, Contents::of(&photos_of(inputs, scene)?)))
}

/// Removes folders that an earlier preparation has made, and its database.
fn clear(scene: &Path, folders: &[&str]) -> Result<()> {
    for folder in folders.iter().map(|name| scene.join(name)).filter(|folder| folder.exists()) {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    let database = scene.join("database.db");
    match database.exists() {
        true => fs::remove_file(&database).with_context(|| format!("cannot remove {}", database.display())),
        false => Ok(()),
    }
}

/// The first names of a list.
pub fn listed(names: &[String]) -> String {
    first_of(names, NAMED)
}

/// A folder name for the i-th of several inputs, different for each.
fn part_name(inputs: &[PathBuf], i: usize) -> String {
    let stem = inputs[i].file_stem().and_then(|stem| stem.to_str()).unwrap_or("photos");
    format!("{:02}_{stem}", i + 1)
}

/// Whether a file has the name of a photo that COLMAP is given.
fn is_photo(path: &Path) -> bool {
    has_extension(path, &picture_extensions())
}

/// `.jpg, .jpeg or .png`.
fn known_extensions() -> String {
    let extensions: Vec<String> = picture_extensions().iter().map(|extension| format!(".{extension}")).collect();
    let (last, first) = extensions.split_last().expect("there are extensions");
    format!("{} or {last}", first.join(", "))
}
