//! The report on a model: one HTML file with its figures, curves and pictures.

pub mod page;
pub mod plot;

use anyhow::{Context, Result};
use ibgs_core::config::TrainConfig;
use ibgs_core::counted;
use ibgs_core::dataset::{HostPhoto, Photo, View};
use ibgs_core::eval::scores::compared;
use ibgs_core::files::write_atomically;
use ibgs_core::gpu::Bytes;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::cameras::Split;
use ibgs_core::output::figures::{Figures, Scores, Speed, Time};
use ibgs_core::output::pictures::Output;
use ibgs_core::output::results::Protocol;
use ibgs_core::picture::{Picture, read_picture};
use ibgs_core::progress::duration;
use page::{Cell, Layer, number};
use plot::{Plot, Series};
use std::path::Path;

/// Longest side of a picture in a page, in pixels.
pub const PICTURE_SIDE: u32 = 800;

/// The contents of a report.
pub struct Report<'a> {
    /// Name of the model.
    pub name: &'a str,
    /// The folder with its pictures.
    pub folder: &'a OutputFolder,
    /// Its figures.
    pub figures: &'a Figures,
    /// The held-out views.
    pub views: &'a [&'a View],
    /// Its options.
    pub config: &'a TrainConfig,
}

impl Report<'_> {
    /// Writes the report.
    pub fn write(&self, path: &Path) -> Result<()> {
        let figures = self.figures;
        let mut body = format!("<p class=\"verdict\">{}</p>\n", page::escape(&verdict(figures)));
        body += &page::list(&origin(figures));
        body += &page::section("Means over the held-out views", &self.means());
        body += &page::section("Training", &training(figures));
        body += &page::section(
            "Speed, memory and storage",
            &page::list(&costs(figures.speed.as_ref(), figures.time.as_ref())),
        );
        body += &page::section("Views", &self.table());
        body += &page::section("Pictures", &self.pictures()?);
        let options = page::escape(&self.config.to_text()?);
        body += &format!("<details><summary>Options</summary>\n<pre>{options}</pre></details>\n");
        let html = page::document(self.name, &body);
        Ok(write_atomically(path, |out| out.write_all(html.as_bytes()))?)
    }

    fn means(&self) -> String {
        let row = |name: &str, scores: &Scores| -> Vec<Cell> {
            let means = &scores.means;
            let values = [number(means.psnr, 3), number(means.ssim, 4), number(means.lpips, 4)];
            std::iter::once(name.to_owned()).chain(values).map(Cell::from).collect()
        };
        let [image, base] = [("final image", &self.figures.image), ("base image", &self.figures.base)]
            .map(|(name, scores)| scores.as_ref().map(|scores| row(name, scores)));
        let rows: Vec<_> = image.into_iter().chain(base).collect();
        let table = page::table(&["", "PSNR in dB ↑", "SSIM ↑", "LPIPS ↓"], &rows);
        let protocol = self.figures.protocol().map(|protocol| format!("Protocol: {}.", sentence(protocol)));
        table + &protocol.map_or_else(String::new, |text| format!("<p class=\"soft\">{}</p>\n", page::escape(&text)))
    }

    /// Scores of every view, base and final image side by side.
    fn table(&self) -> String {
        let scores: Vec<&Scores> = self.figures.image.iter().chain(&self.figures.base).collect();
        let head: &[&str] = match scores.len() {
            2 => &["View", "final PSNR", "SSIM", "LPIPS", "base PSNR", "SSIM", "LPIPS", "gain in dB"],
            _ => &["View", "PSNR", "SSIM", "LPIPS"],
        };
        let row = |view: &&View| {
            let mut row = vec![view.name.clone()];
            for by_view in scores.iter().map(|scores| &scores.views) {
                let cell = |values: &std::collections::BTreeMap<String, Option<f64>>, decimals| {
                    number(values.get(&view.name).copied().flatten(), decimals)
                };
                row.extend([cell(&by_view.psnr, 3), cell(&by_view.ssim, 4), cell(&by_view.lpips, 4)]);
            }
            row.extend((scores.len() == 2).then(|| self.gain(&view.name)));
            row.into_iter().map(Cell::from).collect()
        };
        page::table(head, &self.views.iter().map(row).collect::<Vec<_>>())
    }

    /// PSNR of the final image minus that of the base image, `+1.234`.
    fn gain(&self, view: &str) -> String {
        let psnr = |scores: &Option<Scores>| scores.as_ref()?.views.psnr.get(view).copied().flatten();
        let gain = psnr(&self.figures.image).zip(psnr(&self.figures.base)).map(|(image, base)| image - base);
        gain.map_or_else(|| page::NONE.to_owned(), |gain| format!("{gain:+.3}"))
    }

    fn pictures(&self) -> Result<String> {
        let mut cards = String::new();
        let mut kinds: Vec<&'static str> = Vec::new();
        for (number, view) in self.views.iter().enumerate() {
            HostPhoto::decode_next(self.views[number + 1..].iter().map(|view| &view.photo));
            let photo = compared(view, self.config)?;
            let layers = self.layers(view, &photo)?;
            for layer in &layers {
                if !kinds.contains(&layer.kind) {
                    kinds.push(layer.kind);
                }
            }
            let shown = ["photo", if layers.iter().any(|layer| layer.kind == "final") { "final" } else { "base" }];
            cards += &format!(
                "<div class=\"view\"><h3>{}</h3>\n<p class=\"soft\">{}</p>\n{}</div>\n",
                page::escape(&view.name),
                page::escape(&self.line(view, &photo)),
                page::stage(&view.name, view.photo.size(), &layers, shown)
            );
        }
        if kinds.is_empty() {
            return Ok(String::new());
        }
        let shown = ["photo", if kinds.contains(&"final") { "final" } else { "base" }];
        let chooser = page::chooser(&kinds, shown);
        Ok(format!("{}{chooser}<div class=\"views\">\n{cards}</div>\n", page::error_scale()))
    }

    /// `final 24.86 dB, base 23.33 dB`.
    fn line(&self, view: &View, photo: &Photo) -> String {
        if photo.is_wholly_masked() {
            return "masked as a whole: it has no score and enters no mean".to_owned();
        }
        let view = &view.name;
        let one = |name: &str, scores: &Option<Scores>| {
            let psnr = scores.as_ref()?.views.psnr.get(view).copied().flatten()?;
            Some(format!("{name} {psnr:.2} dB"))
        };
        let parts = [one("final", &self.figures.image), one("base", &self.figures.base)];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// The pictures of a view: photo, renders, errors and residual.
    fn layers(&self, view: &View, photo: &Photo) -> Result<Vec<Layer>> {
        let read = |output: Output| {
            let iteration = self.figures.iteration;
            read_picture(&self.folder.picture_path(Split::Test, iteration, output.folder(), &view.name))
        };
        let (image, base) = (read(Output::Final)?, read(Output::Base)?);
        let image = image.filter(|_| self.figures.image.is_some());
        let error = |picture: &Option<Picture>| picture.as_ref().and_then(|picture| picture.error(photo));
        let (image_error, base_error) = (error(&image), error(&base));
        let residual = image.as_ref().zip(base.as_ref()).and_then(|(image, base)| image.gain(base));
        let pictures = [
            ("photo", Some(Picture::photo(photo))),
            ("final", image),
            ("base", base),
            ("final, error", image_error),
            ("base, error", base_error),
            ("residual, doubled", residual),
        ];
        let layer = |(kind, picture): (&'static str, Option<Picture>)| {
            let uri = |picture: Picture| picture.data_uri(PICTURE_SIDE);
            let uri = picture.map(uri).transpose().with_context(|| format!("the {kind} picture of `{}`", view.name));
            uri.map(|uri| uri.map(|uri| Layer { kind, uri })).transpose()
        };
        pictures.into_iter().filter_map(layer).collect()
    }
}

/// What came out, in one line: PSNR of final and base image, and the view that is farthest from its photo.
fn verdict(figures: &Figures) -> String {
    let psnr = |scores: &Option<Scores>| scores.as_ref()?.means.psnr;
    let (image, base) = (psnr(&figures.image), psnr(&figures.base));
    let means = match (image, base) {
        (Some(image), Some(base)) => {
            let gain = image - base;
            let word = if gain < 0.0 { "loses" } else { "gains" };
            format!("Final image {image:.2} dB, base image {base:.2} dB: the residual {word} {:.2} dB.", gain.abs())
        }
        (Some(image), None) => format!("Final image {image:.2} dB."),
        (None, Some(base)) => format!("Base image {base:.2} dB."),
        (None, None) => "No mean PSNR is known.".to_owned(),
    };
    let views = figures.image.as_ref().or(figures.base.as_ref()).map(|scores| &scores.views.psnr);
    let known = views.into_iter().flatten().filter_map(|(name, psnr)| Some((name, (*psnr)?)));
    match known.min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((name, psnr)) => format!("{means} Worst view: {name} with {psnr:.2} dB."),
        None => means,
    }
}

/// Where the model comes from.
fn origin(figures: &Figures) -> Vec<(String, String)> {
    let mut rows = vec![("Iteration".to_owned(), figures.iteration.to_string())];
    if let Some(time) = &figures.time {
        rows.extend(time.commands.iter().map(|command| ("Command line".to_owned(), command.clone())));
        rows.push(("Trained on".to_owned(), time.device.clone()));
        rows.extend(time.seconds.map(|seconds| ("Training time".to_owned(), duration(seconds))));
    }
    rows
}

/// The conditions of the measurement, in one sentence.
pub fn sentence(protocol: &Protocol) -> String {
    let Protocol { resampler, factor, split, principal_point, masks, device, lpips } = protocol;
    let lpips = lpips.as_ref().map_or_else(|| "not computed".to_owned(), Clone::clone);
    format!(
        "photos at `--resolution {factor}`, resampled by {resampler}; held out {split}; principal point \
         {principal_point}; masks {masks}; LPIPS {lpips}; rendered on {device}"
    )
}

/// Curves of a training.
fn training(figures: &Figures) -> String {
    let entries = &figures.log.entries;
    let logged = |value: fn(&ibgs_core::output::log::LogEntry) -> f64| {
        entries.iter().map(|entry| [f64::from(entry.iteration), value(entry)]).collect::<Vec<_>>()
    };
    let series = |name: &str, points: Vec<[f64; 2]>, marked| Series { name: name.to_owned(), points, marked };
    let measured = |points: &[[f64; 2]]| points.to_vec();
    let x = "iteration";
    let psnr = vec![
        series("held-out views, final image", measured(&figures.image_psnr), true),
        series("held-out views, base image", measured(&figures.base_psnr), true),
        series("training photos", logged(|entry| entry.psnr.into()), false),
    ];
    let plots = [
        Plot { title: "PSNR", x, y: "dB", series: psnr },
        Plot { title: "Loss", x, y: "loss", series: vec![series("loss", logged(|entry| entry.loss.into()), false)] },
        Plot {
            title: "Gaussians",
            x,
            y: "number",
            series: vec![series("Gaussians", logged(|entry| entry.gaussians as f64), false)],
        },
    ];
    plot::beside(&plots)
}

/// A size on disk in units of 10^6 bytes, as in papers.
pub fn megabytes(bytes: u64) -> String {
    format!("{:.2} MB", bytes as f64 * 1e-6)
}

/// Speed, memory, storage and training as names and values.
pub fn costs(speed: Option<&Speed>, time: Option<&Time>) -> Vec<(String, String)> {
    let mut rows: Vec<(String, String)> = Vec::new();
    let mut add = |name: &str, value: Option<String>| {
        if let Some(value) = value {
            rows.push((name.to_owned(), value));
        }
    };
    let bytes = |bytes: Option<u64>| bytes.map(|bytes| Bytes(bytes).to_string());
    if let Some(speed) = speed {
        let fps = |fps: Option<f64>| fps.map(|fps| format!("{fps:.1}"));
        let storage = &speed.storage_bytes;
        add("Gaussians", speed.gaussians.map(|count| count.to_string()));
        add("Frames a second, depth maps kept", fps(speed.fps_warm));
        add("Frames a second, depth maps made for every frame", fps(speed.fps_cold));
        add("Device memory", bytes(speed.memory_reserved_bytes));
        add("Storage", storage.total().map(megabytes));
        let parts = [
            ("Storage: Gaussians", storage.gaussians),
            ("Storage: network", storage.network),
            ("Storage: photos", storage.photos),
            ("Storage: poses", storage.poses),
        ];
        for (name, part) in parts {
            add(name, part.map(megabytes));
        }
        add("Rendered on", Some(speed.device.clone()));
    }
    if let Some(time) = time {
        let iterations =
            time.iterations.map_or_else(String::new, |count| format!(" ({})", counted(count, "iteration")));
        add("Training", time.seconds.map(|seconds| duration(seconds) + &iterations));
        // In the order of the training.
        let mut stages: Vec<_> = time.stages.iter().collect();
        stages.sort_by_key(|(name, _)| ["base", "surface", "residual"].iter().position(|known| known == name));
        for (name, stage) in stages {
            let peak = bytes(stage.peak_reserved_bytes).map_or_else(String::new, |peak| format!(", peak {peak}"));
            add(&format!("Training: {name}"), Some(format!("{}{peak}", duration(stage.seconds))));
        }
        add("Trained on", Some(time.device.clone()));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::output::figures::{ByView, Means};

    fn scores(psnr: f64, views: &[(&str, Option<f64>)]) -> Option<Scores> {
        let psnrs = views.iter().map(|(name, psnr)| ((*name).to_owned(), *psnr)).collect();
        let views = ByView { psnr: psnrs, ..ByView::default() };
        Some(Scores { means: Means { psnr: Some(psnr), ..Means::default() }, views })
    }

    #[test]
    fn a_verdict_is_one_line() {
        let image = scores(24.5, &[("a", Some(28.0)), ("b", Some(21.0)), ("masked", None)]);
        let base = scores(23.0, &[("a", Some(20.0)), ("b", Some(26.0))]);
        let both = Figures { image: image.clone(), base: base.clone(), ..Figures::default() };
        let says = |figures: &Figures, expected: &str| assert_eq!(verdict(figures), expected);
        says(
            &both,
            "Final image 24.50 dB, base image 23.00 dB: the residual gains 1.50 dB. Worst view: b with 21.00 dB.",
        );
        let worse = Figures { image: base.clone(), base: image, ..Figures::default() };
        says(
            &worse,
            "Final image 23.00 dB, base image 24.50 dB: the residual loses 1.50 dB. Worst view: a with 20.00 dB.",
        );
        let alone = Figures { base, ..Figures::default() };
        says(&alone, "Base image 23.00 dB. Worst view: a with 20.00 dB.");
        says(&Figures::default(), "No mean PSNR is known.");
    }
}
