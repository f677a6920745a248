//! What can be wrong with a scene on disk. Each message says what, where and what to do, in one sentence.

use crate::counted;
pub(crate) use crate::files::without_mark;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Why a scene could not be read. Causes are part of the message, so no error has a separate source.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The operating system refused to read a file or a folder.
    #[error("cannot read {}: {cause}; check that it exists and may be read", path.display())]
    Read {
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        cause: String,
    },
    /// The folder holds no scene that is understood.
    #[error(
        "{} is not a scene: it has {wanted}; give the folder (or a .zip of it) that holds one of them", path.display()
    )]
    NotAScene {
        /// The folder given.
        path: PathBuf,
        /// What would show a scene, each with `no` before it.
        wanted: String,
    },
    /// Several files could be the scene's list of cameras.
    #[error("{} has several camera files: {}; give the one that is meant in place of the folder", path.display(), files.join(", "))]
    SeveralListings {
        /// The folder.
        path: PathBuf,
        /// Names of the files.
        files: Vec<String>,
    },
    /// The photos lie on no one colour.
    #[error("the photos of {} do not lie on one colour, so `data.alpha` cannot be `keyed`; leave it out", path.display())]
    NoBackdrop {
        /// The file that lists the photos.
        path: PathBuf,
    },
    /// The photo folder is absent.
    #[error("photo folder {} does not exist", path.display())]
    NoPhotoFolder {
        /// The folder looked for.
        path: PathBuf,
    },
    /// Poses without names that are not as many as the photos.
    #[error(
        "{} has {poses} poses, but {} has {photos} photos: they belong together in the order of the photos' names, so add \
         the photos that are missing or remove those without a pose", path.display(), folder.display()
    )]
    PoseCount {
        /// The file of the poses.
        path: PathBuf,
        /// The folder of the photos.
        folder: PathBuf,
        /// Poses in the file.
        poses: usize,
        /// Photos in the folder.
        photos: usize,
    },
    /// A binary file ends early.
    #[error(
        "{} ends at byte {offset} inside {what}: the file is truncated, copy or export it again",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Byte offset where the data was needed.
        offset: usize,
        /// The field that was being read.
        what: &'static str,
    },
    /// A count in a binary file cannot be true.
    #[error(
        "{} claims {claimed} {what} at byte {offset}, but the rest of the file has room for at most {room}: \
         the file is damaged, copy or export it again", path.display()
    )]
    Count {
        /// The file.
        path: PathBuf,
        /// Byte offset of the count.
        offset: usize,
        /// What is counted.
        what: &'static str,
        /// The count.
        claimed: u64,
        /// The largest count that the file's length allows.
        room: u64,
    },
    /// A binary file has bytes after its last record.
    #[error(
        "{} has {left} bytes left at byte {offset} after its {count} {what}: the count at its start is wrong, \
         copy or export it again", path.display()
    )]
    Trailing {
        /// The file.
        path: PathBuf,
        /// Byte offset of the first byte left over.
        offset: usize,
        /// What is counted.
        what: &'static str,
        /// Number of records read.
        count: usize,
        /// Bytes left.
        left: usize,
    },
    /// A line of a text file, or a byte position of a binary one, holds something else than the format asks for.
    #[error("{}, {place}: {problem}; correct it or export the file again", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// `line 12` or `byte 345`.
        place: String,
        /// What is wrong.
        problem: String,
    },
    /// A JSON file does not parse.
    #[error("{} is not the JSON expected here: {cause}; correct it at that place", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The parser's reason, with line and column.
        cause: String,
    },
    /// A field of a JSON file has a value that makes no sense.
    #[error("{}, {field}: {problem}; correct this field", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field, such as `frames[3].transform_matrix`.
        field: String,
        /// What is wrong.
        problem: String,
    },
    /// A camera model that this loader cannot undistort.
    #[error(
        "{}, {camera}: camera model {model} is not supported; {}", path.display(), without_model(model)
    )]
    CameraModel {
        /// The file.
        path: PathBuf,
        /// The camera or frame.
        camera: String,
        /// The model's name or number.
        model: String,
    },
    /// Intrinsics that no camera has.
    #[error("{}, {camera}: {problem}; correct the intrinsics or calibrate again", path.display())]
    Intrinsics {
        /// The file.
        path: PathBuf,
        /// The camera or frame.
        camera: String,
        /// What is wrong.
        problem: String,
    },
    /// A pose that is no rotation and translation.
    #[error("{}, image `{image}`: {problem}; pose this photo again or remove it from the file", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// The image.
        image: String,
        /// What is wrong.
        problem: String,
    },
    /// An image refers to a camera that the model lacks.
    #[error(
        "{}, image `{image}`: camera {camera} is not in the cameras file; export cameras and images together",
        path.display()
    )]
    CameraNotFound {
        /// The images file.
        path: PathBuf,
        /// The image.
        image: String,
        /// The camera id asked for.
        camera: u32,
    },
    /// An image name that is empty, leaves the scene folder, has control characters, or is absolute with no suffix that
    /// is a photo of the scene.
    #[error(
        "{}: image name `{name}` is empty, or absolute without a photo of that name in the scene, or contains `..` or control \
         characters; use a path inside the photo folder",
        path.display()
    )]
    ImageName {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// Two images of one name.
    #[error("{}: image `{name}` is listed twice; remove one of the two", path.display())]
    DuplicateImage {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// The scene lists no image at all.
    #[error("{} lists no images; reconstruct the scene again", path.display())]
    NoImages {
        /// The file.
        path: PathBuf,
    },
    /// None of the listed photos exists.
    #[error("none of the {count} photos of {} exists (the first would be {})", path.display(), first.display())]
    NoPhotos {
        /// The scene.
        path: PathBuf,
        /// Number of photos listed.
        count: usize,
        /// Where the first was looked for.
        first: PathBuf,
    },
    /// A photo does not decode.
    #[error("photo {} does not decode: {cause}; replace it with a whole JPEG, PNG, WebP, TIFF or EXR file", path.display())]
    Photo {
        /// The photo.
        path: PathBuf,
        /// The decoder's reason.
        cause: String,
    },
    /// A mask of another shape than its photo.
    #[error(
        "mask {} has {} x {} pixels, another shape than the {} x {} of its photo {}; make the mask from this photo as its \
         file stores it, or move the mask elsewhere",
        path.display(), size.0, size.1, photo_size.0, photo_size.1, photo.display()
    )]
    MaskShape {
        /// The mask.
        path: PathBuf,
        /// Its width and height.
        size: (u32, u32),
        /// The photo.
        photo: PathBuf,
        /// Its width and height.
        photo_size: (u32, u32),
    },
    /// A photo that is decoded again, as the host's memory holds too few, is another one now.
    #[error("photo {} has changed while it was in use; start again", path.display())]
    PhotoChanged {
        /// The photo.
        path: PathBuf,
    },
    /// A photo in a format that is known but not read.
    #[error(
        "photo {} is a {format} file, which is not read; convert it to JPEG or PNG under the same name (for example with \
         `{converter}`)", path.display()
    )]
    PhotoFormat {
        /// The photo.
        path: PathBuf,
        /// Name of the format.
        format: &'static str,
        /// A program that converts it.
        converter: &'static str,
    },
    /// Too few photos to train from.
    #[error("{} has {}, at least 2 are needed; add photos or change the split", path.display(), counted(*count, what))]
    TooFewViews {
        /// The scene.
        path: PathBuf,
        /// Number found.
        count: usize,
        /// `view` or `training view`.
        what: &'static str,
    },
    /// A PLY file that does not hold points.
    #[error("{}: {problem}; give an ASCII or binary PLY with vertex properties x, y, z", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line or byte.
        problem: String,
    },
    /// An archive that cannot be unpacked.
    #[error("{}: {problem}; pack the scene again, as plain files in a ZIP archive", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// Trouble with the files of an archive.
    #[error("{message}")]
    InArchive {
        /// What is wrong with the unpacked files.
        error: Box<DatasetError>,
        /// Its message with the archive's name in the paths.
        message: String,
    },
    /// An option outside its range.
    #[error("option `{option}`: `{value}` is not allowed; use {allowed}")]
    Option {
        /// The option as an options file names it, such as `data.resolution`.
        option: &'static str,
        /// The value given.
        value: String,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// What to do about photos through a camera model that is not supported.
fn without_model(model: &str) -> &'static str {
    match model {
        "EQUIRECTANGULAR" | "SPHERICAL" => {
            "cut the panoramas into perspective photos and pose those (COLMAP's example panorama_sfm.py does both)"
        }
        _ => {
            "undistort the photos first (for example with `colmap image_undistorter`) or use one of SIMPLE_PINHOLE, \
             PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, SIMPLE_FISHEYE, FISHEYE, SIMPLE_RADIAL_FISHEYE, \
             RADIAL_FISHEYE, OPENCV_FISHEYE, THIN_PRISM_FISHEYE, FOV"
        }
    }
}

impl DatasetError {
    /// Wraps an error of the operating system.
    pub(crate) fn read(path: &Path, cause: &std::io::Error) -> DatasetError {
        DatasetError::Read { path: path.to_owned(), cause: cause.to_string() }
    }

    /// A wrong line of a text file; `line` counts from 1.
    pub(crate) fn line(path: &Path, line: usize, problem: impl Into<String>) -> DatasetError {
        let place = format!("line {line}");
        DatasetError::Format { path: path.to_owned(), place, problem: problem.into() }
    }

    /// A wrong value at a byte offset of a binary file.
    pub(crate) fn byte(path: &Path, offset: usize, problem: impl Into<String>) -> DatasetError {
        let place = format!("byte {offset}");
        DatasetError::Format { path: path.to_owned(), place, problem: problem.into() }
    }

    /// A wrong field of a JSON file.
    pub(crate) fn field(path: &Path, field: impl Into<String>, problem: impl Into<String>) -> DatasetError {
        DatasetError::Field { path: path.to_owned(), field: field.into(), problem: problem.into() }
    }
}

/// Reads a whole file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, DatasetError> {
    std::fs::read(path).map_err(|cause| DatasetError::read(path, &cause))
}

/// Reads a JSON file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, DatasetError> {
    serde_json::from_slice(without_mark(&read_bytes(path)?))
        .map_err(|cause| DatasetError::Json { path: path.to_owned(), cause: cause.to_string() })
}
