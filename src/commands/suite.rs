//! `ibgs suite`: all scenes of a benchmark, or all runs of a study.

mod blocks;
mod config;
mod processes;
mod summary;

use super::eval::LpipsRange;
use crate::signals::{self, Stopped, on_stop};
use crate::stderr;
use crate::stdout;
use anyhow::{Context, Result, bail};
use clap::{Args as ClapArgs, ValueEnum};
use config::{Job, Suite};
use ibgs_core::config::TrainConfig;
use ibgs_core::files;
use ibgs_core::output::OutputFolder;
use processes::Processes;
use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use summary::Figures;

/// `2/5`: the second of five parts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shard {
    part: usize,
    of: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(part, of)| Some((part.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((part, of)) if 1 <= part && part <= of => Ok(Shard { part, of }),
        _ => Err("give PART/COUNT, for instance 2/5 for the second of five parts".to_owned()),
    }
}

const EXAMPLES: &str = "\
Examples:
  ibgs suite configs/benchmarks/mip-nerf-360.toml --data scenes --adapters 0,1
  ibgs suite plan                                # the blocks of `ibgs split`";

/// Options of `ibgs suite`.
#[derive(ClapArgs, Clone)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Configuration (TOML) of scenes, options, runs and published figures; `configs/` has the usual benchmarks. Or the folder of
    /// a plan of `ibgs split`: its blocks are trained, merged and measured.
    config: PathBuf,
    /// Folder of the scenes, each in a folder of its name.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder for models, logs and summary [default: output/NAME, by the name of the configuration]; for a plan the folder of the
    /// merged model [default: PLAN/model].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Names of the scenes to train, separated by commas [default: all].
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
    /// Names of the configuration's runs to do, separated by commas [default: all].
    #[arg(long, value_delimiter = ',')]
    runs: Vec<String>,
    /// Iterations of every run [default: as in the configuration].
    #[arg(long)]
    iterations: Option<u32>,
    /// Adapters to use at the same time, one process each, by number or part of their names [default: the most
    /// capable].
    #[arg(long, visible_alias = "adapter", value_delimiter = ',')]
    adapters: Vec<String>,
    /// Work on one part only, PART/COUNT such as 2/5; for several machines.
    #[arg(long, value_parser = shard)]
    shard: Option<Shard>,
    /// Also measure LPIPS (VGG) with these weights, as in `ibgs eval`.
    #[arg(long, value_name = "FILE", num_args = 1..=2)]
    lpips_weights: Vec<PathBuf>,
    /// Range of the values that LPIPS reads.
    #[arg(long, value_enum, default_value_t, requires = "lpips_weights")]
    lpips_range: LpipsRange,
    /// Train nothing; write the summary of the runs that exist.
    #[arg(long)]
    summary_only: bool,
}

impl Args {
    /// Options of `ibgs eval` for LPIPS.
    fn lpips(&self) -> Vec<OsString> {
        if self.lpips_weights.is_empty() {
            return Vec::new();
        }
        let range = self.lpips_range.to_possible_value().expect("no range is hidden");
        let files = self.lpips_weights.iter().map(OsString::from);
        ["--lpips-range".into(), range.get_name().into(), "--lpips-weights".into()].into_iter().chain(files).collect()
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    if args.config.is_dir() {
        return blocks::run(args);
    }
    let mut suite = Suite::load(&args.config)?;
    suite.keep(&args.scenes, &args.runs)?;
    let name = args.config.file_stem().and_then(|name| name.to_str()).unwrap_or("suite");
    let output = args.output.clone().unwrap_or_else(|| Path::new("output").join(name));
    let jobs = suite.jobs(&args.data, &output, args.iterations, &args.lpips())?;
    let missing: Vec<&str> = suite.missing(&args.data).collect();
    for scene in &missing {
        stderr!("note: {} has no scene `{scene}`; it is left out", args.data.display());
    }
    for scene in suite.without_surface(&args.data) {
        stderr!("note: scene `{scene}` has no true surface; its meshes are not measured");
    }
    if jobs.is_empty() {
        bail!("{} has none of the scenes of {}", args.data.display(), args.config.display());
    }
    let failed = if args.summary_only { Vec::new() } else { work(&jobs, args, &stopped_by_signals())? };
    let figures: Vec<Figures> = jobs.iter().map(Figures::read).collect::<Result<_>>()?;
    let text = summary::text(&suite, &jobs, &figures);
    stdout!("{text}");
    let write = |name: &str, text: &str| {
        let path = output.join(name);
        files::write_atomically(&path, |out| out.write_all(text.as_bytes()))
    };
    files::create_folder(&output)?;
    write("summary.md", &text)?;
    write("summary.json", &format!("{:#}\n", summary::json(&suite, &jobs, &figures)))?;
    stderr!("summary in {}", output.join("summary.md").display());
    match failed.first() {
        None => Ok(()),
        Some(first) => {
            bail!("{} of {} runs failed; the first one's log is {}", failed.len(), jobs.len(), first.display())
        }
    }
}

/// Work for one adapter, in processes of its own.
trait Task: Sync {
    /// What it is, for the terminal.
    fn title(&self) -> String;

    /// The file with the output of the processes.
    fn log(&self) -> PathBuf;

    /// Whether nothing is left to do.
    fn is_done(&self) -> bool;

    /// Does what is left, in one process after the other, until one fails or none may start. Returns the last one's status; none
    /// where no process was started.
    fn run(&self, program: &Path, adapter: Option<&String>, processes: &Processes) -> Result<Option<ExitStatus>>;

    /// What the processes said last.
    fn last_line(&self) -> String {
        let text = std::fs::read_to_string(self.log()).unwrap_or_default();
        text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("no word").to_owned()
    }
}

/// Processes to which a signal is passed on: they save and end, and no new one starts.
fn stopped_by_signals() -> Arc<Processes> {
    let processes = Arc::new(Processes::default());
    let running = processes.clone();
    on_stop(move || running.terminate());
    processes
}

/// Does the unfinished jobs, one per adapter at a time; returns the logs of failed jobs.
fn work<T: Task>(jobs: &[T], args: &Args, processes: &Processes) -> Result<Vec<PathBuf>> {
    let mine = |(index, _): &(usize, &T)| args.shard.is_none_or(|s| index % s.of == s.part - 1);
    let todo: Vec<&T> = jobs.iter().enumerate().filter(mine).map(|(_, job)| job).collect();
    let (done, todo): (Vec<&T>, Vec<&T>) = todo.into_iter().partition(|job| job.is_done());
    let todo = VecDeque::from(todo);
    if !done.is_empty() {
        stderr!("{} of {} runs are there already", done.len(), done.len() + todo.len());
    }
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let (count, queue, failed) = (todo.len(), Mutex::new(todo), Mutex::new(Vec::new()));
    let next = || {
        let mut queue = queue.lock().expect("queue");
        let job = queue.pop_front().filter(|_| !processes.is_closed());
        job.map(|job| (job, count - queue.len()))
    };
    let adapters: Vec<Option<&String>> = match args.adapters.is_empty() {
        true => vec![None],
        false => args.adapters.iter().map(Some).collect(),
    };
    std::thread::scope(|scope| {
        let worker = |adapter| {
            while let Some((job, number)) = next() {
                stderr!("{number}/{count} {} (log: {})", job.title(), job.log().display());
                let error = match job.run(&program, adapter, processes) {
                    Ok(Some(status)) if status.success() && job.is_done() => continue,
                    // A signal stopped this process alone: the user wants the suite to end.
                    Ok(Some(status)) if signals::is_stopped(status.code()) => {
                        processes.close();
                        continue;
                    }
                    _ if processes.is_closed() => continue,
                    Ok(_) => job.last_line(),
                    Err(error) => format!("{error:#}"),
                };
                stderr!("{number}/{count} {}: failed: {error}", job.title());
                failed.lock().expect("list").push(job.log());
            }
        };
        for adapter in adapters {
            scope.spawn(move || worker(adapter));
        }
    });
    if processes.is_closed() {
        bail!(Stopped("stopped; the same command continues with what is left"));
    }
    Ok(failed.into_inner().expect("list"))
}

impl Job {
    /// The steps that are left when these figures exist.
    fn steps(&self, figures: &Figures) -> Vec<Step> {
        // A training measures at its end and then removes its checkpoints.
        let trains = !figures.has("PSNR") || self.is_stopped();
        let lacks = |name| trains || !figures.has(name);
        let steps = [
            (Step::Train, trains),
            (Step::Eval, lacks("FPS") || !self.lpips.is_empty() && lacks("LPIPS")),
            (Step::Mesh, self.mesh.is_some() && lacks("F1")),
        ];
        steps.into_iter().filter(|(_, wanted)| *wanted).map(|(step, _)| step).collect()
    }

    /// Whether a training was stopped or killed before its last iteration.
    fn is_stopped(&self) -> bool {
        OutputFolder::at(&self.folder).checkpoints().is_ok_and(|found| !found.is_empty())
    }
}

impl Task for Job {
    fn title(&self) -> String {
        format!("{}: training", self.name())
    }

    fn log(&self) -> PathBuf {
        self.folder.with_extension("log")
    }

    /// Whether everything is measured.
    fn is_done(&self) -> bool {
        Figures::read(self).is_ok_and(|figures| self.steps(&figures).is_empty())
    }

    fn run(&self, program: &Path, adapter: Option<&String>, processes: &Processes) -> Result<Option<ExitStatus>> {
        if let Some(parent) = self.folder.parent() {
            files::create_folder(parent)?;
        }
        let options = self.folder.with_extension("toml");
        // A stopped training is resumed, unless the configuration has changed since.
        let same = TrainConfig::load(&options).is_ok_and(|mut config| {
            config.data.host_memory = self.config.data.host_memory;
            config == self.config
        });
        let resumes = same && self.is_stopped();
        self.config.save(&options)?;
        let log = File::create(self.log()).with_context(|| format!("cannot write {}", self.log().display()))?;
        // An unreadable folder counts as empty.
        let steps = self.steps(&Figures::read(self).unwrap_or_default());
        let mut last = None;
        for step in steps {
            let mut command = Command::new(program);
            match step {
                Step::Train if resumes => command.args(["train", "--resume", "-m"]).arg(&self.folder),
                Step::Train => {
                    command.args(["train", "--overwrite", "--config"]).arg(&options).arg("-m").arg(&self.folder)
                }
                Step::Eval => command.arg("eval").arg(&self.folder).args(&self.lpips),
                Step::Mesh => command.arg("mesh").arg(&self.folder).args(self.mesh.iter().flatten()),
            };
            command.args(adapter.iter().flat_map(|name| ["--adapter", name.as_str()]));
            command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log.try_clone()?);
            let Some(status) = processes.run(&mut command)? else { break };
            last = Some(status);
            if !status.success() || step == Step::Train && self.is_stopped() {
                break;
            }
        }
        Ok(last)
    }
}

/// A process of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Train,
    Eval,
    Mesh,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_counted_from_one() {
        assert_eq!(shard("2/5"), Ok(Shard { part: 2, of: 5 }));
        for bad in ["0/5", "6/5", "2", "a/b", "1/0", "-1/2"] {
            assert!(shard(bad).unwrap_err().contains("PART/COUNT"), "{bad}");
        }
    }
}
