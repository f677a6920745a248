//! `config.toml`: the options of a run as a file.

use super::{ConfigError, TrainConfig, removed};
use crate::files::{self, TomlError};
use std::io;
use std::path::Path;

impl TrainConfig {
    /// Reads options from a TOML file; fields that are left out have their defaults.
    ///
    /// # Errors
    /// [`ConfigError`] naming the file and the line or field.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::from_text(&text, path)
    }

    /// Reads options from the text of a TOML file; `path` is for messages.
    ///
    /// # Errors
    /// [`ConfigError`] naming the line or field.
    pub fn from_text(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let config: Self = files::parse_toml(text).map_err(|TomlError { line, reason }| ConfigError::Parse {
            path: path.to_owned(),
            line,
            reason: removed::instead(text, &reason).unwrap_or(reason),
        })?;
        config.validate_from(Some(path))?;
        Ok(config)
    }

    /// Writes the options as TOML, in one atomic step.
    ///
    /// # Errors
    /// Those of [`validate`](Self::validate) (nothing is written then) and [`ConfigError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), ConfigError> {
        self.validate()?;
        files::write_atomically(path, |out| out.write_all(self.to_text().map_err(io::Error::other)?.as_bytes()))?;
        Ok(())
    }

    /// The options as TOML.
    ///
    /// # Errors
    /// A value that TOML cannot hold, which [`validate`](Self::validate) refuses.
    pub fn to_text(&self) -> Result<String, toml::ser::Error> {
        let text = toml::to_string_pretty(self)?;
        Ok(format!("# Options of a training run.\n\n{text}\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Alpha, ColorSpace, Masks, Resampler};
    use crate::residual::variant::Aggregation;

    fn load(text: &str) -> Result<TrainConfig, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        std::fs::write(&path, text).unwrap();
        TrainConfig::load(&path)
    }

    #[test]
    fn round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        let mut config = TrainConfig::default();
        config.save(&path).unwrap();
        assert_eq!(TrainConfig::load(&path).unwrap(), config);
        config.source = Some("a folder/scene".into());
        config.data.images = Some("images_4".to_owned());
        config.data.alpha = Some(Alpha::Composite);
        config.data.masks = Some(Masks::Object);
        config.data.color_space = Some(ColorSpace::Linear);
        config.eval_iterations = Some(vec![1, 2, 300]);
        config.densify.end = Some(1234);
        config.learning_rates.mean_initial = 1.0 / 3.0;
        config.sources.memory = "1.5GiB".parse().unwrap();
        config.sources.max_distance = Some(4.5);
        config.residual.halve_at = Some(vec![]);
        config.residual.aggregation = Aggregation::Mean;
        config.save(&path).unwrap();
        assert_eq!(TrainConfig::load(&path).unwrap(), config);
        assert_eq!(load("").unwrap(), TrainConfig::default());
        let some = "method = \"ibgs\"\n[sources]\ndistances = \"absolute\"\nmax-angle-deg = 50\n[residual]\nfactor = 1";
        assert_eq!(load(some).unwrap().sources.max_angle_deg, 50.0);
    }

    #[test]
    fn options_of_the_photos_are_written_as_they_were_given() {
        for text in ["1", "8", "1008", "-1"] {
            let config = load(&format!("[data]\nresolution = \"{text}\"\nresampler = \"bicubic\"")).unwrap();
            assert_eq!(config.data.resampler, Resampler::Bicubic);
            assert!(config.to_text().unwrap().contains(&format!("resolution = \"{text}\"")), "{text}");
        }
        let text = TrainConfig::default().to_text().unwrap();
        for line in ["resolution = \"1\"", "resampler = \"lanczos3\"", "principal-point = \"true\""] {
            assert!(text.lines().any(|found| found == line), "{line} is not in {text}");
        }
    }

    #[test]
    fn unknown_fields_are_named_with_their_line() {
        let text = load("seed = 3\n\n[densify]\nintervall = 5\n").unwrap_err().to_string();
        assert!(text.contains("config.toml, line 4"), "{text}");
        assert!(text.contains("`intervall`") && !text.contains('\n'), "{text}");
        assert!(load("method = \"4dgs\"").is_err());
        assert!(load("iterations = -1").is_err());
        let text = load("[sources]\nmemory = \"much\"").unwrap_err().to_string();
        assert!(text.contains("line 2") && text.contains("512MiB"), "{text}");
        assert!(load("[residual]\naggregation = \"all\"").unwrap_err().to_string().contains("soft"));
        for (text, word) in [
            ("[data]\nmasks = \"thing\"", "`object`"),
            ("[data]\nprincipal-point = \"middle\"", "`centred`"),
            ("[data]\nresampler = \"box\"", "`lanczos3`"),
            ("[exposure]\nenabled = \"maybe\"", "`auto`"),
        ] {
            let error = load(text).unwrap_err().to_string();
            assert!(error.contains("line 2") && error.contains(word), "{error}");
        }
        assert!(load("iterations = ").is_err());
    }

    #[test]
    fn senseless_values_are_refused_by_name() {
        let cases = [
            ("iterations = 0", "iterations"),
            ("sh-degree = 4", "sh-degree"),
            ("ssim-weight = nan", "ssim-weight"),
            ("initial-scale = 0.0", "initial-scale"),
            ("[densify.mcmc]\ngrowth = 0.5", "densify.mcmc.growth"),
            ("eval-iterations = [0]", "eval-iterations"),
            ("[data]\neval-split-every = 1", "data.eval-split-every"),
            ("[data]\nresolution = \"3\"", "data.resolution"),
            ("[learning-rates]\nopacity = -1.0", "learning-rates.opacity"),
            ("[learning-rates]\nmean-final = 0.0", "learning-rates.mean-final"),
            ("[adam]\nbeta2 = 1.0", "adam.beta2"),
            ("[densify]\ninterval = 0", "densify.interval"),
            ("[densify]\nsplit-divisor = inf", "densify.split-divisor"),
            ("[opacity-reset]\nmax-opacity = 1.5", "opacity-reset.max-opacity"),
            ("[sources]\nmax-angle-deg = 0", "sources.max-angle-deg"),
            ("[sources]\nused = 9", "sources.used"),
            ("[sources]\nneighbours = 3", "sources.neighbours"),
            ("[sources]\nvisible = 0", "sources.visible"),
            ("[sources]\nmin-distance = 2.0\nmax-distance = 1.0", "sources.max-distance"),
            ("[surface]\nintersections = 3", "surface.intersections"),
            ("[residual]\nfactor = 0.3", "residual.factor"),
            ("[residual]\nhalve-at = [0]", "residual.halve-at"),
            ("[residual]\nburn-in-gain = -0.5", "residual.burn-in-gain"),
            ("[residual]\ndropout = 1.0", "residual.dropout"),
            ("[exposure]\nlearning-rate = nan", "exposure.learning-rate"),
            ("[poses]\nfinal-learning-rate = 0.0", "poses.final-learning-rate"),
        ];
        for (text, field) in cases {
            let message = load(text).unwrap_err().to_string();
            assert!(message.contains(&format!("`{field}`")), "{message}");
            assert!(message.contains("config.toml"), "{message}");
        }
        let config = TrainConfig { seed: u64::MAX, ..TrainConfig::default() };
        assert!(config.validate().unwrap_err().to_string().starts_with("option `seed` is"));
    }
}
