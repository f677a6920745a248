//! Poses by one of COLMAP's two mappers. The incremental one adds photo after photo. The global one solves for all photos at
//! once; COLMAP 4 has it, and so has the program `glomap`.

use super::{Colmap, MORE_OVERLAP, models, registered};
use crate::arguments;
use crate::prepare::tool::Tool;
use crate::signals::Stopped;
use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use ibgs_core::counted;
use ibgs_core::progress::Progress;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// Fraction of the photos with a pose below which something went wrong.
pub const ENOUGH: f64 = 0.8;

/// Fewest photos for which the global mapper is taken where the choice is free. Of few photos, of which each overlaps with few
/// others, it gives wrong poses with small errors.
const MANY: usize = 100;

/// The global mapper's steps, by what it prints when one begins.
const STAGES: [&str; 6] = [
    "view graph calibration",
    "rotation averaging",
    "track establishment",
    "global positioning",
    "bundle adjustment",
    "retriangulation",
];

/// What estimates the poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapper {
    #[default]
    /// For 100 photos or more the global mapper where there is one, and the incremental one where it fails or finds few poses.
    Auto,
    /// COLMAP's incremental mapper, which adds photo after photo.
    Incremental,
    /// The global mapper of COLMAP 4 or newer, or of the program `glomap`.
    Global,
}

/// A global mapper that is there.
enum Global {
    /// COLMAP's own; `calibrates`: a command of its own estimates focal lengths first.
    Own {
        calibrates: bool,
    },
    Glomap(Tool),
}

/// What there is to choose from.
pub(super) struct Mappers {
    wanted: Mapper,
    global: Option<Global>,
    /// Of COLMAP.
    version: String,
}

impl Mappers {
    /// `help` is what COLMAP prints of itself.
    ///
    /// # Errors
    /// The global mapper is wanted, and there is none.
    pub fn new(wanted: Mapper, tool: &Tool, help: &str, [major, minor]: [u32; 2]) -> Result<Self> {
        let has = |command| help.split_whitespace().any(|word| word == command);
        let glomap = || {
            let tool = tool.other("glomap");
            let help = tool.output(&["-h"]).unwrap_or_default();
            help.to_ascii_lowercase().contains("glomap").then_some(Global::Glomap(tool))
        };
        let global = match wanted {
            Mapper::Incremental => None,
            _ if has("global_mapper") => Some(Global::Own { calibrates: has("view_graph_calibrator") }),
            _ => glomap(),
        };
        let version = format!("{major}.{minor}");
        if wanted == Mapper::Global && global.is_none() {
            bail!(
                "COLMAP {version} has no global mapper, and the program `glomap` was not found; install COLMAP 4 or newer, or leave \
                 `--mapper` out"
            );
        }
        Ok(Self { wanted, global, version })
    }

    /// The global mapper if it is the one for so many photos, and a sentence that says which one it is and why.
    fn choose(&self, photos: usize) -> (Option<&Global>, String) {
        let version = &self.version;
        let global = self.global.as_ref().filter(|_| self.wanted == Mapper::Global || photos >= MANY);
        let why = match (global, &self.global) {
            (Some(Global::Own { .. }), _) => format!("poses by the global mapper of COLMAP {version}"),
            (Some(Global::Glomap(_)), _) => {
                format!("poses by the global mapper `glomap`, since COLMAP {version} has none of its own")
            }
            (None, Some(_)) => {
                format!("poses by COLMAP's incremental mapper, which is the surer one for fewer than {MANY} photos")
            }
            (None, None) if self.wanted == Mapper::Incremental => {
                "poses by COLMAP's incremental mapper, as asked for".to_owned()
            }
            (None, None) => format!(
                "poses by COLMAP's incremental mapper: COLMAP {version} has no global one (4.0 and newer have it), and there is no \
                 program `glomap`"
            ),
        };
        (global, why)
    }
}

impl Colmap {
    /// Estimates poses and points from the start. `note` is told which mapper does it, and what it is doing.
    ///
    /// # Errors
    /// As [`Tool::run`]; no model was found.
    pub fn map(&self, photos: usize, progress: &dyn Progress, note: &mut dyn FnMut(String)) -> Result<()> {
        let (global, why) = self.mappers.choose(photos);
        note(why);
        // Of a preparation that was stopped.
        remove(&self.work())?;
        let Some(global) = global else { return self.map_incrementally(photos, progress) };
        let is_only = self.mappers.wanted == Mapper::Global;
        let problem = match self.map_globally(global, note) {
            Err(error) if is_only || error.is::<Stopped>() => return Err(error),
            Err(error) => format!("failed: {error:#}"),
            Ok(()) => {
                let posed = self.posed()?;
                if is_only || posed as f64 >= ENOUGH * photos as f64 {
                    return Ok(());
                }
                format!("gives {posed} of {photos} photos a pose")
            }
        };
        note(format!("the global mapper {problem}; now the incremental one"));
        self.map_instead(photos, progress, note)
    }

    /// The incremental mapper after the global one, whose poses stay where they are more.
    fn map_instead(&self, photos: usize, progress: &dyn Progress, note: &mut dyn FnMut(String)) -> Result<()> {
        let (sparse, kept) = (self.sparse(), self.work().join("sparse"));
        let before = self.posed()?;
        empty(&self.work())?;
        rename(&sparse, &kept)?;
        let mapped = self.map_incrementally(photos, progress);
        if mapped.as_ref().is_err_and(|error| error.is::<Stopped>()) {
            return mapped;
        }
        let after = self.posed()?;
        if before > after {
            note(format!(
                "the incremental mapper gives {} a pose, so the global one's poses stay",
                counted(after, "photo")
            ));
            remove(&sparse)?;
            rename(&kept, &sparse)?;
        }
        remove(&self.work())?;
        if before == 0 { mapped } else { Ok(()) }
    }

    fn map_incrementally(&self, photos: usize, progress: &dyn Progress) -> Result<()> {
        let sparse = self.sparse();
        empty(&sparse)?;
        let mut arguments = arguments!["mapper", "--database_path", self.database()].to_vec();
        arguments.extend(arguments!["--image_path", self.images(), "--output_path", &sparse]);
        let (mut most, mut has_start) = (0, true);
        let mapped = self.follow(&arguments, ("poses", photos), progress, |line| {
            has_start &= !line.to_ascii_lowercase().contains("no good initial");
            // A model that leads nowhere is begun again and counts from the start.
            most = most.max(registered(line).unwrap_or(0));
            most
        });
        mapped.map_err(|error| match has_start {
            _ if error.is::<Stopped>() => error,
            true => error.context("the poses could not be estimated"),
            false => error.context(format!("no two photos overlap well enough to begin with; {MORE_OVERLAP}")),
        })
    }

    fn map_globally(&self, global: &Global, note: &mut dyn FnMut(String)) -> Result<()> {
        empty(&self.sparse())?;
        // It changes focal lengths in the database; the incremental mapper begins without that.
        empty(&self.work())?;
        let database = self.work().join("database.db");
        fs::copy(self.database(), &database).with_context(|| format!("cannot write {}", database.display()))?;
        let solved = self.solve(global, &database, note);
        remove(&self.work())?;
        solved
    }

    fn solve(&self, global: &Global, database: &Path, note: &mut dyn FnMut(String)) -> Result<()> {
        let mut stages = Stages::default();
        let (tool, command) = match global {
            Global::Own { .. } => (&self.tool, "global_mapper"),
            Global::Glomap(tool) => (tool, "mapper"),
        };
        if matches!(global, Global::Own { calibrates: true }) {
            stages.begun(STAGES[0]).into_iter().for_each(&mut *note);
            tool.run(&arguments!["view_graph_calibrator", "--database_path", database], |_| {})?;
        }
        let mut arguments = arguments![command, "--database_path", database].to_vec();
        arguments.extend(arguments!["--image_path", self.images(), "--output_path", self.sparse()]);
        tool.run(&arguments, |line| {
            let begun = line.split("Running ").nth(1).and_then(|what| stages.begun(what));
            begun.into_iter().for_each(&mut *note);
        })
    }

    /// Photos with a pose in the largest model.
    fn posed(&self) -> Result<usize> {
        Ok(models(&self.sparse())?.into_iter().map(|(posed, _)| posed).max().unwrap_or(0))
    }
}

/// How far the global mapper is: stages that have begun.
#[derive(Default)]
struct Stages(usize);

impl Stages {
    /// A sentence on a stage that begins for the first time.
    fn begun(&mut self, what: &str) -> Option<String> {
        let stage = STAGES.iter().position(|name| what.contains(name)).filter(|stage| *stage >= self.0)?;
        self.0 = stage + 1;
        Some(format!("global mapper, step {} of {}: {}", self.0, STAGES.len(), STAGES[stage]))
    }
}

/// Makes an empty folder of it.
fn empty(folder: &Path) -> Result<()> {
    remove(folder)?;
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))
}

fn remove(folder: &Path) -> Result<()> {
    match folder.exists() {
        true => fs::remove_dir_all(folder).with_context(|| format!("cannot remove {}", folder.display())),
        false => Ok(()),
    }
}

fn rename(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).with_context(|| format!("cannot rename {}", from.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stage_is_told_once_and_in_order() {
        let mut stages = Stages::default();
        let told = [
            "rotation averaging",
            "rotation averaging ...",
            "iterative bundle adjustment",
            "global positioning",
            "iterative retriangulation and refinement",
            "duration (h:mm:ss): ",
        ]
        .map(|what| stages.begun(what));
        let step = |number, what| Some(format!("global mapper, step {number} of 6: {what}"));
        let expected =
            [step(2, "rotation averaging"), None, step(5, "bundle adjustment"), None, step(6, "retriangulation"), None];
        assert_eq!(told, expected);
    }
}
