//! The configuration of a suite: its scenes, options, runs and published figures.

use anyhow::{Context, Result, bail};
use ibgs_core::config::TrainConfig;
use ibgs_core::files::parse_toml;
use serde::Deserialize;
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A benchmark or a study.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Suite {
    /// Title of the summary.
    pub title: String,
    /// Note on the figures, for the reader.
    #[serde(default)]
    pub note: String,
    /// Options of all runs, as in `config.toml` of a training run.
    #[serde(default)]
    options: Table,
    /// The scenes.
    pub scenes: Vec<Scene>,
    /// The runs on each scene; default: one with the options above.
    #[serde(default = "one_run")]
    pub runs: Vec<Run>,
    /// Figures of the literature, to compare with ours.
    #[serde(default)]
    pub published: Vec<Published>,
}

/// One scene.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Scene {
    /// Name of the scene and of its folder.
    pub name: String,
    /// Folder in the data folder, if it has another name.
    folder: Option<PathBuf>,
    /// Whether it is the built-in demo scene.
    #[serde(default)]
    demo: bool,
    /// Options of this scene.
    #[serde(default)]
    options: Table,
    /// The true surface to compare its mesh with; that of the demo scene is known.
    mesh: Option<Surface>,
}

/// A true surface: options of `ibgs mesh`, with files in the scene's folder.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Surface {
    compare: Option<PathBuf>,
    transform: Option<PathBuf>,
    crop: Option<PathBuf>,
    threshold: Option<f64>,
    density: Option<f64>,
    max_distance: Option<f64>,
}

impl Surface {
    /// The options of `ibgs mesh`; the demo scene has no folder.
    fn arguments(&self, folder: Option<&Path>) -> Vec<OsString> {
        let demo = folder.is_none().then(|| ("--compare", OsString::from("demo")));
        let files = [("--compare", &self.compare), ("--transform", &self.transform), ("--crop", &self.crop)];
        let numbers =
            [("--threshold", self.threshold), ("--density", self.density), ("--max-distance", self.max_distance)];
        let files = files.into_iter().filter_map(|(name, file)| Some((name, folder?.join(file.as_ref()?).into())));
        let numbers = numbers.into_iter().filter_map(|(name, value)| Some((name, value?.to_string().into())));
        demo.into_iter().chain(files).chain(numbers).flat_map(|(name, value)| [name.into(), value]).collect()
    }
}

/// Options under a name.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Run {
    /// Its name.
    pub name: String,
    /// Options of this run.
    #[serde(default)]
    options: Table,
}

/// A row of a published table; figures that it does not state are left out.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Published {
    /// Method, or variant of the method.
    pub method: String,
    /// Scene or benchmark; empty: the mean over the scenes.
    #[serde(default)]
    pub on: String,
    /// PSNR in dB.
    pub psnr: Option<f64>,
    /// Structural similarity.
    pub ssim: Option<f64>,
    /// LPIPS with VGG.
    pub lpips: Option<f64>,
    /// F1 of the mesh.
    pub f1: Option<f64>,
    /// Chamfer distance of the mesh.
    pub chamfer: Option<f64>,
    /// Frames per second.
    pub fps: Option<f64>,
    /// Training time in minutes.
    pub minutes: Option<f64>,
    /// Storage in MB.
    pub storage_mb: Option<f64>,
    /// Peak GPU memory of rendering, in GB.
    pub memory_gb: Option<f64>,
    /// Millions of Gaussians.
    pub gaussians_m: Option<f64>,
}

fn one_run() -> Vec<Run> {
    vec![Run { name: "ibgs".to_owned(), options: Table::new() }]
}

/// One training with its measurement.
#[derive(Clone, Debug)]
pub struct Job {
    /// Name of the run.
    pub run: String,
    /// Name of the scene.
    pub scene: String,
    /// Its options.
    pub config: TrainConfig,
    /// Its model folder.
    pub folder: PathBuf,
    /// Options of `ibgs mesh`; none if there is no true surface to compare with.
    pub mesh: Option<Vec<OsString>>,
    /// Options of `ibgs eval` for LPIPS; empty without LPIPS.
    pub lpips: Vec<OsString>,
}

impl Job {
    /// `scene, run`.
    pub fn name(&self) -> String {
        format!("{}, {}", self.scene, self.run)
    }
}

/// Overrides the entries of `under` with those of `over`, tables entry by entry.
fn merge(under: &mut Table, over: &Table) {
    for (key, value) in over {
        match (under.get_mut(key), value) {
            (Some(Value::Table(under)), Value::Table(over)) => merge(under, over),
            _ => {
                under.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Whether a name can be one component of a path.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\', ':', '\0'])
}

impl Suite {
    /// Reads a configuration.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read the configuration {}; check the path", path.display()))?;
        Self::from_text(&text).with_context(|| format!("{} is no configuration of a suite", path.display()))
    }

    fn from_text(text: &str) -> Result<Self> {
        let suite: Self = parse_toml(text)?;
        for (what, names) in [
            ("scene", suite.scenes.iter().map(|scene| &scene.name).collect::<Vec<_>>()),
            ("run", suite.runs.iter().map(|run| &run.name).collect()),
        ] {
            let mut seen = HashSet::new();
            for name in names {
                if !is_plain(name) {
                    bail!("the {what} `{name}` must have a name without `/` that does not begin with a dot");
                }
                if !seen.insert(name) {
                    bail!("there are two {what}s `{name}`; give them different names");
                }
            }
        }
        // Errors are found before anything is trained.
        for scene in &suite.scenes {
            for run in &suite.runs {
                suite.config(scene, run)?;
            }
        }
        Ok(suite)
    }

    /// Keeps only the named scenes and runs; an empty list keeps all.
    pub fn keep(&mut self, scenes: &[String], runs: &[String]) -> Result<()> {
        let known = |what: &str, wanted: &[String], names: Vec<&String>| {
            let unknown = wanted.iter().find(|name| !names.contains(name));
            let list = || names.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(", ");
            unknown.map_or(Ok(()), |name| bail!("the configuration has no {what} `{name}`; it has {}", list()))
        };
        known("scene", scenes, self.scenes.iter().map(|scene| &scene.name).collect())?;
        known("run", runs, self.runs.iter().map(|run| &run.name).collect())?;
        self.scenes.retain(|scene| scenes.is_empty() || scenes.contains(&scene.name));
        self.runs.retain(|run| runs.is_empty() || runs.contains(&run.name));
        Ok(())
    }

    fn config(&self, scene: &Scene, run: &Run) -> Result<TrainConfig> {
        let mut table = self.options.clone();
        merge(&mut table, &scene.options);
        merge(&mut table, &run.options);
        let place = format!("options of scene `{}` and run `{}`", scene.name, run.name);
        Ok(TrainConfig::from_text(&toml::to_string(&table)?, Path::new(&place))?)
    }

    fn source(scene: &Scene, data: &Path) -> PathBuf {
        data.join(scene.folder.as_deref().unwrap_or(Path::new(&scene.name)))
    }

    /// Scenes that are missing in the data folder.
    pub fn missing<'a>(&'a self, data: &'a Path) -> impl Iterator<Item = &'a str> {
        let missing = |scene: &&Scene| !scene.demo && !Self::source(scene, data).exists();
        self.scenes.iter().filter(missing).map(|scene| scene.name.as_str())
    }

    /// Scenes that exist without the true surface to compare their meshes with.
    pub fn without_surface<'a>(&'a self, data: &'a Path) -> impl Iterator<Item = &'a str> {
        let without = move |scene: &&Scene| {
            let file = scene.mesh.as_ref().and_then(|surface| surface.compare.as_ref());
            let folder = Self::source(scene, data);
            folder.exists() && file.is_some_and(|file| !folder.join(file).exists())
        };
        self.scenes.iter().filter(without).map(|scene| scene.name.as_str())
    }

    /// Every run of every scene that exists.
    pub fn jobs(&self, data: &Path, output: &Path, iterations: Option<u32>, lpips: &[OsString]) -> Result<Vec<Job>> {
        let missing: HashSet<&str> = self.missing(data).collect();
        let bare: HashSet<&str> = self.without_surface(data).collect();
        let mut jobs = Vec::new();
        for scene in self.scenes.iter().filter(|scene| !missing.contains(scene.name.as_str())) {
            for run in &self.runs {
                let mut config = self.config(scene, run)?;
                config.iterations = Some(iterations.unwrap_or_else(|| config.iterations()));
                config.data.eval = true;
                config.source = match scene.demo {
                    true => None,
                    false => Some(std::path::absolute(Self::source(scene, data))?),
                };
                config.validate()?;
                let folder = output.join(&run.name).join(&scene.name);
                let surface = scene.mesh.as_ref().filter(|_| !bare.contains(scene.name.as_str()));
                let source = Some(Self::source(scene, data)).filter(|_| !scene.demo);
                let mesh = surface.map(|surface| surface.arguments(source.as_deref()));
                let (run, scene, lpips) = (run.name.clone(), scene.name.clone(), lpips.to_vec());
                jobs.push(Job { run, scene, config, folder, mesh, lpips });
            }
        }
        Ok(jobs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::dataset::{Masks, Resolution};

    const TEXT: &str = r#"
        title = "Study"
        options = { iterations = 7000, data = { resolution = "2" } }
        [[scenes]]
        name = "one"
        options.data.max-resolution = 100
        [[scenes]]
        name = "two"
        folder = "elsewhere/two"
        [[scenes]]
        name = "demo"
        demo = true
        [[runs]]
        name = "plain"
        [[runs]]
        name = "wide"
        options = { iterations = 10, data = { resolution = "4" } }
    "#;

    #[test]
    fn options_are_merged_from_suite_scene_and_run() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("one")).unwrap();
        let mut suite = Suite::from_text(TEXT).unwrap();
        assert_eq!(suite.missing(folder.path()).collect::<Vec<_>>(), ["two"]);
        let jobs = suite.jobs(folder.path(), Path::new("out"), None, &[]).unwrap();
        let titles: Vec<String> = jobs.iter().map(Job::name).collect();
        assert_eq!(titles, ["one, plain", "one, wide", "demo, plain", "demo, wide"]);
        let [plain, wide] = [&jobs[0], &jobs[1]];
        assert_eq!((plain.config.iterations(), plain.config.data.resolution), (7000, Resolution::Factor(2)));
        assert_eq!((wide.config.iterations(), wide.config.data.resolution), (10, Resolution::Factor(4)));
        assert_eq!((plain.config.data.max_resolution, wide.config.data.max_resolution), (Some(100), Some(100)));
        assert!(plain.config.source.is_some() && jobs[2].config.source.is_none());
        assert_eq!(wide.folder, Path::new("out/wide/one"));
        suite.keep(&["demo".to_owned()], &["wide".to_owned()]).unwrap();
        assert_eq!(suite.jobs(folder.path(), Path::new("out"), Some(3), &[]).unwrap()[0].config.iterations, Some(3));
        // Without a length its jobs say which one they have: results are found by it.
        let unset = Suite::from_text(&TEXT.replace("iterations = 7000, ", "")).unwrap();
        let jobs = unset.jobs(folder.path(), Path::new("out"), None, &[]).unwrap();
        assert_eq!(jobs[0].config.iterations, Some(30_000));
        assert!(
            suite.keep(&["three".to_owned()], &[]).unwrap_err().to_string().contains("no scene `three`; it has demo")
        );
    }

    #[test]
    fn mistakes_are_named() {
        let refused = |text: &str| format!("{:#}", Suite::from_text(text).unwrap_err());
        let scene = "title = \"a\"\n[[scenes]]\nname = \"one\"\n";
        for (text, words) in [
            ("title = \"a\"", "missing field `scenes`"),
            (&format!("{scene}sice = 3"), "line 4: unknown field `sice`"),
            (&format!("{scene}[[scenes]]\nname = \"one\""), "two scenes `one`"),
            (&format!("{scene}[[scenes]]\nname = \"../one\""), "`../one` must have a name without"),
            (
                &format!("{scene}[[runs]]\nname = \"r\"\noptions = {{ sh-degree = 7 }}"),
                "run `r`: option `sh-degree` is 7",
            ),
            (&format!("{scene}[[runs]]\nname = \"r\"\noptions = {{ sh-degre = 1 }}"), "unknown field `sh-degre`"),
        ] {
            assert!(refused(text).contains(words), "{}", refused(text));
        }
    }

    #[test]
    fn every_configuration_of_the_project_loads() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let mut count = 0;
        for folder in ["benchmarks", "studies"] {
            for file in std::fs::read_dir(root.join(folder)).unwrap() {
                let path = file.unwrap().path();
                if path.extension().is_some_and(|extension| extension == "toml") {
                    Suite::load(&path).unwrap();
                    count += 1;
                }
            }
        }
        assert!(count > 10, "only {count} configurations");
    }

    /// Figures as published, none where there is none; whole images, as those figures are.
    #[test]
    fn cut_out_objects_are_measured_as_published() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/benchmarks");
        let synthetic = Suite::load(&root.join("nerf-synthetic.toml")).unwrap();
        let names = ["chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship"];
        assert_eq!(synthetic.scenes.iter().map(|scene| scene.name.as_str()).collect::<Vec<_>>(), names);
        let rows: Vec<&str> = synthetic.published.iter().map(|row| row.on.as_str()).collect();
        assert_eq!(rows, [&names[..], &[""]].concat());
        let figures: Vec<f64> = synthetic.published.iter().filter_map(|row| row.psnr).collect();
        let mean = figures[..8].iter().sum::<f64>() / 8.0;
        assert!((mean - figures[8]).abs() < 0.01, "{mean}");
        assert!(
            synthetic.published.iter().all(|row| row.method == "3DGS" && row.ssim.is_none() && row.lpips.is_none())
        );
        let dtu = Suite::load(&root.join("dtu.toml")).unwrap();
        let config = dtu.config(&dtu.scenes[0], &dtu.runs[0]).unwrap();
        assert_eq!((config.data.masks, config.data.resolution), (Some(Masks::Object), Resolution::Factor(2)));
        assert_eq!((dtu.scenes.len(), config.data.eval_split_every), (15, 8));
    }
}
