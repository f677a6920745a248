//! docs/config.md is what the options' types say. With IBGS_BLESS set it is written.

use ibgs_core::config::{AdamMoments, ExposureSwitch, Method, PoseSwitch, Strategy, TrainConfig, TransientSwitch};
use ibgs_core::dataset::{Alpha, ColorSpace, InitialPoints, Masks, PrincipalPoint, Resampler};
use ibgs_core::residual::{Aggregation, Output, Precision};
use ibgs_core::sources::find::{Distances, Draw};
use ibgs_core::words::words;
use std::fmt::Write;
use toml::{Table, Value};

const TRAIN: &str = include_str!("../crates/ibgs-model/src/config.rs");
const DENSIFY: &str = include_str!("../crates/ibgs-model/src/config/densify.rs");
const POSES: &str = include_str!("../crates/ibgs-model/src/config/poses.rs");
const STAGES: &str = include_str!("../crates/ibgs-model/src/config/stages.rs");
const TRANSIENTS: &str = include_str!("../crates/ibgs-model/src/config/transients.rs");
const DATA: &str = include_str!("../crates/ibgs-data/src/dataset/options.rs");
const SOURCES: &str = include_str!("../crates/ibgs-render/src/sources/find.rs");

/// Every table of an options file: its name, its type and the source of that.
const TABLES: [(&str, &str, &str); 14] = [
    ("", "TrainConfig", TRAIN),
    ("data", "LoadOptions", DATA),
    ("learning-rates", "LearningRates", TRAIN),
    ("adam", "AdamConfig", TRAIN),
    ("densify", "DensifyConfig", DENSIFY),
    ("densify.growth", "GrowthConfig", DENSIFY),
    ("densify.mcmc", "McmcConfig", DENSIFY),
    ("opacity-reset", "OpacityResetConfig", DENSIFY),
    ("sources", "SourceOptions", SOURCES),
    ("surface", "SurfaceConfig", STAGES),
    ("residual", "ResidualConfig", STAGES),
    ("exposure", "ExposureConfig", STAGES),
    ("poses", "PoseConfig", POSES),
    ("transients", "TransientConfig", TRANSIENTS),
];

const HEAD: &str = "\
# Options file

`ibgs train --config FILE.toml` reads these options, and `config.toml` of a model folder holds those of its training. An
option that is left out has its default; one without a default may stay unset, and its text says what happens then.
Options of the command line ([cli.md](cli.md)) override the file. Sections of method.md are those of
[method.md](method.md). The tables are made from the source: after a change of an option run
`IBGS_BLESS=1 cargo test config_reference`.
";

/// What stands before the table of strategies.
const STRATEGIES: &str = "
## Strategies

What `densify.strategy` may be, and what each sets where it is unset, for runs of 30,000 iterations.

| strategy | meaning | `interval` | `end` | `max-splats` | opacity resets | `initial-opacity` | `initial-scale` |
|---|---|---|---|---|---|---|---|
";

/// An option as the source has it.
struct Field<'a> {
    name: String,
    kind: &'a str,
    meaning: String,
}

/// The text of the comment above `pub struct NAME`, and its fields that a file may hold.
fn parse<'a>(name: &str, source: &'a str) -> (String, Vec<Field<'a>>) {
    let start = source.find(&format!("pub struct {name} {{")).unwrap_or_else(|| panic!("no struct {name}"));
    let (before, body) = source.split_at(start);
    let comment = |line: &'a str| line.trim().strip_prefix("/// ");
    let above = before.lines().rev().skip_while(|line| line.starts_with("#["));
    let mut title: Vec<&str> = above.map_while(comment).collect();
    title.reverse();
    let (mut fields, mut meaning, mut is_skipped) = (Vec::new(), Vec::new(), false);
    for line in body.lines().skip(1).take_while(|line| *line != "}") {
        if let Some(text) = comment(line) {
            meaning.push(text);
        } else if line.contains("#[serde(skip)]") {
            is_skipped = true;
        } else if let Some((name, kind)) = line.trim().strip_prefix("pub ").and_then(|field| field.split_once(": ")) {
            let field = Field {
                name: name.replace('_', "-"),
                kind: kind.trim_end_matches(','),
                meaning: meaning.join(" ").replace('|', "\\|"),
            };
            meaning.clear();
            if !std::mem::take(&mut is_skipped) {
                fields.push(field);
            }
        }
    }
    (title.join(" "), fields)
}

/// What a file may hold for a type of the source; none for a table.
fn values(kind: &str) -> Option<String> {
    let kind = kind.strip_prefix("Option<").and_then(|kind| kind.strip_suffix('>')).unwrap_or(kind);
    let words = match kind {
        "f64" => return Some("number".to_owned()),
        "u32" | "u64" => return Some("whole number".to_owned()),
        "Vec<u32>" => return Some("list of whole numbers".to_owned()),
        "bool" => return Some("`true`, `false`".to_owned()),
        "String" => return Some("text".to_owned()),
        "PathBuf" => return Some("path".to_owned()),
        "Resolution" => return Some("number as text".to_owned()),
        "MemoryBudget" => return Some("`auto`, `none`, size".to_owned()),
        "Background" => return Some("`white`, `black`, `random`, `R,G,B`".to_owned()),
        "AdamMoments" => words::<AdamMoments>(),
        "Method" => words::<Method>(),
        "Strategy" => return Some("one of the [strategies](#strategies)".to_owned()),
        "Resampler" => words::<Resampler>(),
        "PrincipalPoint" => words::<PrincipalPoint>(),
        "Masks" => words::<Masks>(),
        "Alpha" => words::<Alpha>(),
        "ColorSpace" => words::<ColorSpace>(),
        "InitialPoints" => words::<InitialPoints>(),
        "Distances" => words::<Distances>(),
        "Draw" => words::<Draw>(),
        "Precision" => words::<Precision>(),
        "Output" => words::<Output>(),
        "Aggregation" => words::<Aggregation>(),
        "ExposureSwitch" => words::<ExposureSwitch>(),
        "PoseSwitch" => words::<PoseSwitch>(),
        "TransientSwitch" => words::<TransientSwitch>(),
        table if TABLES.iter().any(|(_, name, _)| *name == table) => return None,
        other => panic!("what may a file hold for {other}?"),
    };
    Some(words.iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", "))
}

fn shown(value: Option<&Value>) -> String {
    match value {
        None => "unset".to_owned(),
        Some(Value::Float(number)) => format!("`{number}`"),
        Some(Value::String(text)) => format!("`\"{text}\"`"),
        Some(value) => format!("`{value}`"),
    }
}

fn options() -> String {
    let defaults = Table::try_from(TrainConfig::default()).unwrap();
    let mut text = HEAD.to_owned();
    for (table, name, source) in TABLES {
        let (title, fields) = parse(name, source);
        let heading = if table.is_empty() { "At the top".to_owned() } else { format!("`[{table}]`") };
        write!(text, "\n## {heading}\n\n{title}\n\n| option | values | default | meaning |\n|---|---|---|---|\n")
            .unwrap();
        let own = table.split('.').filter(|key| !key.is_empty()).try_fold(&defaults, |at, key| at[key].as_table());
        for Field { name, kind, meaning } in fields {
            if let Some(values) = values(kind) {
                let default = shown(own.unwrap().get(&name));
                writeln!(text, "| `{name}` | {values} | {default} | {meaning} |").unwrap();
            }
        }
    }
    text
}

fn reference() -> String {
    let mut text = options() + STRATEGIES;
    for (word, strategy) in words::<Strategy>().iter().zip(Strategy::ALL) {
        assert_eq!(Value::try_from(strategy).unwrap().as_str(), Some(*word));
        let own = strategy.defaults();
        let most = if own.cap_follows_photos { "by the photos".to_owned() } else { format!("`{}`", own.max_splats) };
        let (meaning, resets, [opacity, scale]) =
            (strategy.meaning(), ["no", "yes"][usize::from(own.resets_opacity)], own.start);
        write!(text, "| `{word}` | {meaning} | `{}` | `{}` | {most} ", own.interval, own.end).unwrap();
        writeln!(text, "| {resets} | `{opacity}` | `{scale}` |").unwrap();
    }
    text
}

#[test]
fn config_reference_is_current() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/config.md");
    if std::env::var_os("IBGS_BLESS").is_some() {
        std::fs::write(path, reference()).unwrap();
    }
    let current = std::fs::read_to_string(path).unwrap();
    let (ours, theirs) = (reference(), current.replace("\r\n", "\n"));
    let first = ours.lines().zip(theirs.lines()).find(|(ours, theirs)| ours != theirs);
    assert!(ours == theirs, "docs/config.md is old (IBGS_BLESS=1 writes it): {first:?}");
}

/// Each option of a file stands in the text, and the other way round.
#[test]
fn every_option_has_a_row() {
    fn leaves(table: &Table) -> usize {
        table.values().map(|value| value.as_table().map_or(1, leaves)).sum()
    }
    let text = options();
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| `")).collect();
    let unset = rows.iter().filter(|row| row.contains(" | unset | ")).count();
    assert_eq!(rows.len() - unset, leaves(&Table::try_from(TrainConfig::default()).unwrap()));
    assert!(rows.iter().all(|row| row.split(" | ").last().is_some_and(|meaning| meaning.len() > 8)));
}
