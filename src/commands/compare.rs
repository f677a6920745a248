//! `ibgs compare`: the figures of several models side by side.

mod columns;
mod page;

use super::report::sentence;
use crate::stderr;
use crate::stdout;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use columns::{COLUMNS, Column};
use ibgs_core::files::write_atomically;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::figures::Figures;
use ibgs_core::output::results::Protocol;
use serde_json::{Map, Value, json};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Example:
  ibgs compare output/a output/b -o compare.html";

/// Options of `ibgs compare`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Two or more model folders, as `ibgs train` writes them.
    #[arg(required = true, num_args = 2.., value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Saved iteration of every model [default: the latest of each].
    #[arg(long)]
    iteration: Option<u32>,
    /// Write an HTML page with the table, the curves and the pictures side by side.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the figures to a JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A model and its figures.
struct Run {
    /// The path on the command line.
    name: String,
    folder: OutputFolder,
    figures: Figures,
}

impl Run {
    fn open(path: &Path, iteration: Option<u32>) -> Result<Self> {
        let folder = OutputFolder::open(path)?;
        let latest = folder.latest_iteration()?.context("the folder holds no point cloud")?;
        let iteration = iteration.unwrap_or(latest);
        if !folder.point_cloud_path(iteration).is_file() {
            bail!("{} has no iteration {iteration}; its latest is {latest}", path.display());
        }
        let figures = Figures::read(&folder, iteration)?;
        Ok(Self { name: path.display().to_string(), folder, figures })
    }

    /// Whether views were held out, as far as that is known.
    fn has_held_out(&self) -> bool {
        self.folder.read_config().map_or(true, |config| config.data.eval)
    }

    /// What is missing, and which command adds it.
    fn missing(&self) -> Option<String> {
        let Figures { base, speed, time, iteration, .. } = &self.figures;
        let parts = [("scores", base.is_none()), ("speed and storage", speed.is_none())];
        let eval: Vec<&str> = parts.into_iter().filter(|(_, missing)| *missing).map(|(what, _)| what).collect();
        let eval = (!eval.is_empty()).then(|| {
            let what = eval.join(", ");
            let missing = format!("{} has no {what} of iteration {iteration}", self.name);
            match self.has_held_out() {
                true => format!("{missing}; run `ibgs eval {}`", self.name),
                false => format!("{missing}; no views were held out: train with `--eval` to measure it"),
            }
        });
        let untimed = || format!("{} does not say how long its training to iteration {iteration} took", self.name);
        eval.or_else(|| time.is_none().then(untimed))
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let runs: Vec<Run> = args.models.iter().map(|path| Run::open(path, args.iteration)).collect::<Result<_>>()?;
    let mut seen = HashSet::new();
    if let Some(run) = runs.iter().find(|run| !seen.insert(&run.name)) {
        bail!("{} is named twice; give different model folders", run.name);
    }
    let notes: Vec<String> = runs.iter().filter_map(Run::missing).collect();
    let warnings = differences(&runs);
    print_table(&runs);
    for note in &notes {
        stderr!("note: {note}");
    }
    for warning in &warnings {
        stderr!("warning: {warning}");
    }
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&to_json(&runs, &warnings, &notes))?;
        write_atomically(path, |out| writeln!(out, "{text}"))?;
    }
    if let Some(path) = &args.output {
        page::write(path, &runs, &warnings, &notes)?;
        stderr!("comparison: {}", path.display());
    }
    Ok(())
}

/// One field of a protocol.
type Field = fn(&Protocol) -> Option<&String>;

/// Fields of the protocol. Figures of runs that differ in one are not comparable.
const FIELDS: [(&str, Field); 7] = [
    ("resolution", |p| Some(&p.factor)),
    ("resampler", |p| Some(&p.resampler)),
    ("split", |p| Some(&p.split)),
    ("principal point", |p| Some(&p.principal_point)),
    ("masks", |p| Some(&p.masks)),
    ("device", |p| Some(&p.device)),
    ("LPIPS", |p| p.lpips.as_ref()),
];

/// One sentence per field in which the protocols differ. Unknown values are ignored.
fn differences(runs: &[Run]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (name, field) in FIELDS {
        let of = |run: &'_ Run| run.figures.protocol().and_then(field).map(|value| (run.name.clone(), value.clone()));
        let known: Vec<(String, String)> = runs.iter().filter_map(of).collect();
        if known.iter().any(|(_, value)| *value != known[0].1) {
            let values: Vec<String> = known.iter().map(|(run, value)| format!("{run}: {value}")).collect();
            warnings.push(format!("the models differ in {name}: {}", values.join("; ")));
        }
    }
    warnings.extend(unlike_views(runs));
    warnings
}

/// A sentence if the runs were scored on different views.
fn unlike_views(runs: &[Run]) -> Option<String> {
    let views = |run: &Run| -> Option<Vec<String>> {
        Some(run.figures.base.as_ref()?.views.psnr.keys().cloned().collect()).filter(|names: &Vec<_>| !names.is_empty())
    };
    let known: Vec<Vec<String>> = runs.iter().filter_map(views).collect();
    let unlike = known.iter().any(|names| *names != known[0]);
    unlike.then(|| "the models are not measured on the same views".to_owned())
}

/// The best value of a column; none if fewer than two are known or all are equal.
fn best(runs: &[Run], column: &Column) -> Option<f64> {
    let values: Vec<f64> = runs.iter().filter_map(|run| (column.value)(&run.figures)).collect();
    let (low, high) = (values.iter().copied().reduce(f64::min)?, values.iter().copied().reduce(f64::max)?);
    if values.len() < 2 || low == high {
        return None;
    }
    Some(if column.more_is_better { high } else { low })
}

/// The figures of all runs.
struct Table {
    /// Those that some run has a value for.
    columns: Vec<&'static Column>,
    /// For every run the text of each column, and whether it is the best.
    rows: Vec<Vec<(String, bool)>>,
}

fn table(runs: &[Run]) -> Table {
    let has_values = |column: &&Column| runs.iter().any(|run| (column.value)(&run.figures).is_some());
    let columns: Vec<&Column> = COLUMNS.iter().filter(has_values).collect();
    let best: Vec<Option<f64>> = columns.iter().map(|column| best(runs, column)).collect();
    let row = |run: &Run| {
        let cell = |(column, best): (&&Column, &Option<f64>)| match (column.value)(&run.figures) {
            None => ("-".to_owned(), false),
            Some(value) => ((column.text)(value), Some(value) == *best),
        };
        columns.iter().zip(&best).map(cell).collect()
    };
    let rows = runs.iter().map(row).collect();
    Table { columns, rows }
}

/// Prints the table: one line per model, a star at the best value of each column.
fn print_table(runs: &[Run]) {
    let Table { columns, rows } = table(runs);
    let name_width = runs.iter().map(|run| run.name.chars().count()).max().unwrap_or(0).max("model".len());
    let texts: Vec<Vec<String>> = rows
        .iter()
        .map(|row| row.iter().map(|(text, best)| format!("{text}{}", if *best { "*" } else { " " })).collect())
        .collect();
    let head = columns.iter().map(|column| format!("{} ", column.title)).collect::<Vec<_>>();
    let width = |c: usize| texts.iter().map(|row| row[c].chars().count()).max().unwrap_or(0).max(head[c].len());
    let line = |name: &str, cells: &[String]| {
        let cells: String =
            cells.iter().enumerate().map(|(c, text)| format!("  {text:>width$}", width = width(c))).collect();
        stdout!("{}", format!("{name:<name_width$}{cells}").trim_end());
    };
    line("model", &head);
    for (run, row) in runs.iter().zip(&texts) {
        line(&run.name, row);
    }
    stdout!("* the best of its column");
}

fn to_json(runs: &[Run], warnings: &[String], notes: &[String]) -> Value {
    let one = |run: &Run| {
        let figures = COLUMNS.iter().map(|column| (column.key.to_owned(), json!((column.value)(&run.figures))));
        json!({
            "model": run.name,
            "iteration": run.figures.iteration,
            "figures": figures.collect::<Map<_, _>>(),
            "protocol": run.figures.protocol(),
        })
    };
    json!({ "models": runs.iter().map(one).collect::<Vec<_>>(), "warnings": warnings, "notes": notes })
}

/// How a run was measured, for the page.
fn protocol_line(run: &Run) -> Option<String> {
    run.figures.protocol().map(sentence)
}
