//! A folder that shows a model in a browser.

use super::{Args, refuse_taken};
use crate::commands::report::page::escape;
use anyhow::{Context, Result, bail};
use ibgs_core::bundle::Packing;
use ibgs_core::dataset::Photo;
use ibgs_core::files::write_atomically;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use image::{DynamicImage, RgbaImage};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The page, and its element `<ibgs-viewer>`.
const PAGE: &str = include_str!("../page/index.html");
const ELEMENT: &str = include_str!("../page/ibgs-viewer.js");
/// The viewer's module, as wasm-bindgen writes it.
const MODULE: [&str; 2] = ["ibgs_web.js", "ibgs_web_bg.wasm"];
/// Where the module stands in the folder, and the model.
const MODULE_FOLDER: &str = "pkg";
const BUNDLE: &str = "scene.ibgs";
/// How the model is kept unless options say otherwise.
const SMALL: Packing = Packing::Small { photo_quality: 90 };
const POSTER: &str = "poster.jpg";
/// Longest side of the poster in pixels, and its quality.
const POSTER_SIDE: u32 = 1280;
const POSTER_QUALITY: u8 = 80;

/// Writes page, module, model and poster, and says how large they are.
pub fn write(args: &Args, folder: &Path) -> Result<String> {
    refuse_taken(folder, args.overwrite)?;
    let module = module(args)?;
    let model = args.model.read()?;
    let title = escape(&model.path.file_stem().unwrap_or_default().to_string_lossy());
    let bundle = args.bundle.of(model)?;
    for name in MODULE {
        let bytes =
            fs::read(module.join(name)).with_context(|| format!("cannot read {}", module.join(name).display()))?;
        write_atomically(&folder.join(MODULE_FOLDER).join(name), |out| out.write_all(&bytes))?;
    }
    bundle.write(&folder.join(BUNDLE), args.bundle.packing(SMALL))?;
    let poster = match bundle.photos.first() {
        Some((_, photo)) => {
            let Photo { width, height, rgba } = Arc::unwrap_or_clone(photo.pixels()?);
            let image = DynamicImage::from(RgbaImage::from_raw(width, height, rgba).context("a photo has its size")?);
            let image = match width.max(height) > POSTER_SIDE {
                true => image.resize(POSTER_SIDE, POSTER_SIDE, FilterType::Triangle),
                false => image,
            };
            let mut bytes = Vec::new();
            image.to_rgb8().write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, POSTER_QUALITY))?;
            write_atomically(&folder.join(POSTER), |out| out.write_all(&bytes))?;
            format!(" poster=\"{POSTER}\"")
        }
        None => String::new(),
    };
    let page = PAGE.replace("<title>ibgs</title>", &format!("<title>{title}</title>"));
    let page = page.replace(&format!("src=\"{BUNDLE}\""), &format!("src=\"{BUNDLE}\"{poster}"));
    write_atomically(&folder.join("ibgs-viewer.js"), |out| out.write_all(ELEMENT.as_bytes()))?;
    write_atomically(&folder.join("index.html"), |out| out.write_all(page.as_bytes()))?;
    let size = |path: PathBuf| path.metadata().map(|metadata| metadata.len() as f64 * 1e-6);
    Ok(format!(
        "{} written: model {:.1} MB, module {:.1} MB; `ibgs serve {}` shows it",
        folder.display(),
        size(folder.join(BUNDLE))?,
        size(folder.join(MODULE_FOLDER).join(MODULE[1]))?,
        folder.display()
    ))
}

/// Folder of the viewer's module.
fn module(args: &Args) -> Result<PathBuf> {
    let folder = match &args.module {
        Some(folder) => folder.clone(),
        None => std::env::current_exe()?.parent().context("a program lies in a folder")?.join("web"),
    };
    if let Some(missing) = MODULE.into_iter().find(|name| !folder.join(name).is_file()) {
        bail!(
            "{} is missing: the viewer's module for browsers; `crates/ibgs-web/build.sh` builds it, `ibgs export --web --module` says where it is",
            folder.join(missing).display()
        );
    }
    Ok(folder)
}
