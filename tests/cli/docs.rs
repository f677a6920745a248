//! docs/cli.md against the command line.

use clap::{Command, CommandFactory, Parser};
use ibgs::Cli;
use std::collections::BTreeSet;

const TEXT: &str = include_str!("../../docs/cli.md");
/// What every command that opens a model has.
const COMMON: &str = "Opening a model";

/// The text below a heading, up to the next one of its level.
fn section(heading: &str) -> &'static str {
    let start = TEXT.find(&format!("\n## {heading}\n")).unwrap_or_else(|| panic!("docs/cli.md has no `## {heading}`"));
    let body = &TEXT[start + 1..];
    body[3..].find("\n## ").map_or(body, |end| &body[..end + 3])
}

/// The options of a command by their long names.
fn options(command: &Command) -> BTreeSet<String> {
    let shown = command.get_arguments().filter(|arg| !arg.is_hide_set());
    shown.filter_map(|arg| arg.get_long()).filter(|name| *name != "help").map(|name| format!("--{name}")).collect()
}

/// The options that a text names in code.
fn named(text: &str) -> BTreeSet<String> {
    let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let starts =
        text.match_indices("--").filter(|(at, _)| matches!(text[..*at].chars().last(), Some('`' | ' ' | '[' | '(')));
    starts
        .map(|(at, _)| text[at..].chars().take_while(|c| is_name(*c)).collect::<String>())
        .filter(|name| name.len() > 3)
        .collect()
}

#[test]
fn every_command_and_option_is_documented() {
    let mut program = Cli::command();
    program.build();
    let common = named(section(COMMON));
    let mut missing = Vec::new();
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        let known = named(section(&format!("ibgs {}", command.get_name())));
        let lacks = options(command).into_iter().filter(|option| !known.contains(option) && !common.contains(option));
        missing.extend(lacks.map(|option| format!("ibgs {} {option}", command.get_name())));
    }
    assert!(missing.is_empty(), "docs/cli.md does not name {missing:?}");
}

#[test]
fn no_option_is_documented_that_is_not_there() {
    let mut program = Cli::command();
    program.build();
    let mut known: BTreeSet<String> = program.get_subcommands().flat_map(options).collect();
    // Of cargo, of setup.sh and of the program itself.
    known
        .extend(["--photos", "--release", "--path", "--locked", "--offline", "--help", "--version"].map(str::to_owned));
    let unknown: Vec<String> = named(TEXT).into_iter().filter(|option| !known.contains(option)).collect();
    assert!(unknown.is_empty(), "docs/cli.md names {unknown:?}");
}

/// Help ends in examples, which the command line takes as they stand.
#[test]
fn every_command_has_examples_that_parse() {
    let mut program = Cli::command();
    program.build();
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        let name = command.get_name();
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let (_, examples) = help.split_once("Example").unwrap_or_else(|| panic!("{name} has no example"));
        let mut own = 0;
        for example in examples.lines().filter_map(|line| line.strip_prefix("  ")) {
            // What follows a command of a shell, and the redirection of its output.
            for call in example.split(" && ").filter_map(|call| call.split(" > ").next()) {
                // A remark goes with the comment that it is.
                let words = shlex::split(call).unwrap_or_else(|| panic!("{name}: {call}"));
                if words.first().is_some_and(|program| program == "ibgs") {
                    assert!(Cli::try_parse_from(&words).is_ok(), "{name}: {call}");
                    own += usize::from(words[1] == name);
                }
            }
        }
        assert!(own > 0, "{name} has no example of its own");
    }
}
