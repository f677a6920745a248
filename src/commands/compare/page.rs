//! The comparison as a page.

use super::{Run, Table, protocol_line, table};
use crate::commands::report::PICTURE_SIDE;
use crate::commands::report::page::{self, Cell, escape};
use crate::commands::report::plot::{self, Plot, Series};
use anyhow::{Context, Result};
use ibgs_core::files::write_atomically;
use ibgs_core::output::cameras::Split;
use ibgs_core::output::pictures::{Output, PHOTO_FOLDER};
use ibgs_core::picture::{Picture, read_picture};
use std::collections::BTreeSet;
use std::path::Path;

/// Writes the page.
pub fn write(path: &Path, runs: &[Run], warnings: &[String], notes: &[String]) -> Result<()> {
    let mut body = String::new();
    for text in warnings.iter().chain(notes) {
        body += &format!("<p class=\"note\">{}</p>\n", escape(text));
    }
    body += &page::section("Figures", &figures(runs));
    body += &page::section("Training", &curves(runs));
    body += &page::section("Pictures", &pictures(runs)?);
    let protocols = runs.iter().filter_map(|run| Some((run.name.clone(), protocol_line(run)?))).collect::<Vec<_>>();
    if !protocols.is_empty() {
        body += &page::section("Protocols", &page::list(&protocols));
    }
    let html = page::document("Comparison of models", &body);
    Ok(write_atomically(path, |out| out.write_all(html.as_bytes()))?)
}

fn figures(runs: &[Run]) -> String {
    let Table { columns, rows } = table(runs);
    let titles = columns.iter().map(|column| column.title);
    let head: Vec<&str> = ["Model", "iteration"].into_iter().chain(titles).collect();
    let row = |(run, cells): (&Run, Vec<(String, bool)>)| {
        let first = [run.name.clone(), run.figures.iteration.to_string()].map(Cell::from);
        first.into_iter().chain(cells.into_iter().map(|(text, best)| Cell { text, best })).collect()
    };
    let rows: Vec<Vec<Cell>> = runs.iter().zip(rows).map(row).collect();
    page::table(&head, &rows)
}

/// PSNR and loss over the training, of every run that recorded them.
fn curves(runs: &[Run]) -> String {
    let measured = |run: &Run| {
        let figures = &run.figures;
        let points = if figures.image_psnr.is_empty() { &figures.base_psnr } else { &figures.image_psnr };
        Series { name: run.name.clone(), points: points.clone(), marked: true }
    };
    let loss = |run: &Run| {
        let entries = &run.figures.log.entries;
        let points = entries.iter().map(|entry| [f64::from(entry.iteration), f64::from(entry.loss)]).collect();
        Series { name: run.name.clone(), points, marked: false }
    };
    let x = "iteration";
    let plots = [
        Plot { title: "PSNR of held-out views", x, y: "dB", series: runs.iter().map(measured).collect() },
        Plot { title: "Loss", x, y: "loss", series: runs.iter().map(loss).collect() },
    ];
    plot::beside(&plots)
}

/// The views of all runs, each with its photo and the image of every run.
fn pictures(runs: &[Run]) -> Result<String> {
    let scores = runs.iter().filter_map(|run| run.figures.base.as_ref());
    let names: BTreeSet<&String> = scores.flat_map(|scores| scores.views.psnr.keys()).collect();
    let mut html = String::new();
    for name in names {
        let read = |run: &Run, folder: &str| {
            read_picture(&run.folder.picture_path(Split::Test, run.figures.iteration, folder, name))
        };
        let mut shown = Vec::new();
        for run in runs {
            let image = if run.figures.image.is_some() { read(run, Output::Final.folder())? } else { None };
            let picture = match image {
                Some(image) => Some(image),
                None => read(run, Output::Base.folder())?,
            };
            shown.push((run, picture));
        }
        let mut photo = None;
        for run in runs {
            photo = match photo {
                None => read(run, PHOTO_FOLDER)?,
                found => found,
            };
        }
        html += &format!("<h3>{}</h3>\n<div class=\"beside\">\n", escape(name));
        html += &figure("photo", name, "photo", photo)?;
        for (run, picture) in shown {
            html += &figure(&run.name, name, &caption(run, name), picture)?;
        }
        html += "</div>\n";
    }
    Ok(html)
}

/// `runs/a: 24.86 dB`.
fn caption(run: &Run, view: &str) -> String {
    let scores = run.figures.image.as_ref().or(run.figures.base.as_ref());
    let psnr = scores.and_then(|scores| scores.views.psnr.get(view).copied().flatten());
    psnr.map_or_else(|| run.name.clone(), |psnr| format!("{}: {psnr:.2} dB", run.name))
}

fn figure(what: &str, view: &str, caption: &str, picture: Option<Picture>) -> Result<String> {
    let caption = escape(caption);
    let Some(picture) = picture else {
        return Ok(format!(
            "<figure><div class=\"absent\">no picture of this view</div><figcaption>{caption}</figcaption></figure>\n"
        ));
    };
    let crisp = if picture.width < 320 { " class=\"crisp\"" } else { "" };
    let uri = picture.data_uri(PICTURE_SIDE).with_context(|| format!("the picture of `{view}`"))?;
    let alt = escape(&format!("{what}, {view}"));
    Ok(format!("<figure><img{crisp} alt=\"{alt}\" src=\"{uri}\"><figcaption>{caption}</figcaption></figure>\n"))
}
