//! `#import name` puts `wgsl/shared/name.wgsl` in place, once. After `#define NAME` the lines between `#if NAME` and its `#else` or
//! `#endif` count, without it those between `#else` and `#endif`: kernels that are variants of each other share one file. The lines
//! between `#repeat name count` and `#end` come `count` times, with the number of the repetition in place of `$name`: drivers do
//! not unroll every loop that they should. A count is a number or the name of a shared constant.
//!
//! A kernel begins with what the host is told of it, which the build script reads (build/header.rs) and which leaves no line
//! here: `//!` and a sentence of documentation, `#set` and the kernel's set, `#stage` and its stage, by the names of class.rs.
//!
//! A file is one kernel, which has its name, or several that belong together, such as a loss and its gradient. A line `#kernel name`
//! then begins each of them; what stands above the first such line is a part of all.

use super::constants::whole_numbers;

/// The lines of a file that make one of its kernels.
pub fn lines_of<'a>(kernel: &str, source: &'a str) -> impl Iterator<Item = &'a str> {
    let mut counts = true;
    source.lines().filter(move |line| match name_of(line) {
        Some(name) => {
            counts = name == kernel;
            false
        }
        None => counts,
    })
}

/// The kernel that a line begins.
pub fn name_of(line: &str) -> Option<&str> {
    line.trim_end().strip_prefix("#kernel ")
}

/// The WGSL of a kernel from the text of its file: imports, variants and repetitions resolved; `defined`: names that are defined
/// before it; `shared`: name and text of the files that may be imported.
///
/// # Panics
/// When a kernel imports a file that does not exist, a condition or a repetition has no end, or a repetition no count: mistakes in
/// this crate, caught by its build.
pub fn resolve(kernel: &str, source: &str, defined: &[&str], shared: &[(&str, &str)]) -> String {
    let mut expansion = Expansion { shared, imported: Vec::new(), defined: defined.to_vec(), text: String::new() };
    expansion.file(lines_of(kernel, source));
    repeat(&expansion.text)
}

/// Repetitions may hold others.
fn repeat(source: &str) -> String {
    let mut out = String::new();
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        let Some(repetition) = line.trim_start().strip_prefix("#repeat ") else {
            out.push_str(line);
            out.push('\n');
            continue;
        };
        let parsed = repetition.split_once(' ').and_then(|(name, text)| Some((name, count(text)?)));
        let Some((name, count)) = parsed else { panic!("WGSL repetition without name and count: {repetition}") };
        let (mut body, mut depth) = (String::new(), 1);
        while depth > 0 {
            let Some(line) = lines.next() else { panic!("WGSL repetition without end: {repetition}") };
            match line.trim_start() {
                "#end" => depth -= 1,
                inner if inner.starts_with("#repeat ") => depth += 1,
                _ => {}
            }
            if depth > 0 {
                body.push_str(line);
                body.push('\n');
            }
        }
        for number in 0..count {
            out.push_str(&repeat(&body.replace(&format!("${name}"), &number.to_string())));
        }
    }
    out
}

fn count(text: &str) -> Option<u32> {
    text.parse().ok().or_else(|| whole_numbers().find(|(name, _)| *name == text).map(|(_, value)| value))
}

struct Expansion<'a> {
    shared: &'a [(&'a str, &'a str)],
    imported: Vec<&'a str>,
    defined: Vec<&'a str>,
    text: String,
}

impl<'a> Expansion<'a> {
    fn file(&mut self, lines: impl Iterator<Item = &'a str>) {
        // Whether the lines of each open condition count, and whether no `#else` has come yet.
        let mut conditions: Vec<(bool, bool)> = Vec::new();
        for line in lines {
            let (directive, name) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
            match directive {
                "#if" => conditions.push((self.defined.contains(&name), true)),
                "#else" => {
                    let Some((condition, is_first)) = conditions.last_mut() else { panic!("WGSL #else without #if") };
                    assert!(std::mem::take(is_first), "a second WGSL #else");
                    *condition = !*condition;
                }
                "#endif" => assert!(conditions.pop().is_some(), "WGSL #endif without #if"),
                _ if conditions.iter().any(|(condition, _)| !condition) => {}
                "#define" => self.defined.push(name),
                "#import" => self.import(name),
                "//!" | "#set" | "#stage" => {}
                _ => {
                    self.text.push_str(line);
                    self.text.push('\n');
                }
            }
        }
        assert!(conditions.is_empty(), "WGSL #if without #endif");
    }

    fn import(&mut self, name: &'a str) {
        if self.imported.contains(&name) {
            return;
        }
        self.imported.push(name);
        let Some((_, text)) = self.shared.iter().find(|(file, _)| *file == name) else {
            panic!("WGSL import of unknown file {name}");
        };
        self.file(text.lines());
    }
}

#[cfg(test)]
mod tests {
    const SHARED: &[(&str, &str)] = &[("one", "fn one() {}\n"), ("both", "#import one\nfn two() {}\n")];

    fn resolve(source: &str) -> String {
        super::resolve("one", source, &[], SHARED)
    }

    #[test]
    fn repeats_with_the_number_in_place() {
        let text = resolve("a\n    #repeat k 2\n    let x$k = $ku;\n    #end\nb\n");
        assert_eq!(text, "a\n    let x0 = 0u;\n    let x1 = 1u;\nb\n");
    }

    #[test]
    fn repetitions_hold_others() {
        let text = resolve("#repeat r 2\n#repeat k 2\nlet x$r$k;\n#end\nlet y$r;\n#end\n");
        assert_eq!(text, "let x00;\nlet x01;\nlet y0;\nlet x10;\nlet x11;\nlet y1;\n");
    }

    #[test]
    fn a_count_has_a_name() {
        let text = resolve("#repeat n MLP_FEATURES\nx$n\n#end\n");
        assert_eq!(text.lines().count(), crate::layers::FEATURES);
    }

    #[test]
    #[should_panic(expected = "without name and count: n NOTHING")]
    fn a_count_is_known() {
        resolve("#repeat n NOTHING\nx$n\n#end\n");
    }

    #[test]
    fn imports_once() {
        let text = resolve("#import one\n#import one\n#import both\nfn f() {}\n");
        assert_eq!(text, "fn one() {}\nfn two() {}\nfn f() {}\n");
    }

    #[test]
    fn kernels_of_a_file_share_what_stands_above_them() {
        let source = "#set train\na\n#kernel loss\n//! Forward.\nb\n#kernel loss_backward \n#import one\nc\n";
        assert!(source.lines().filter_map(super::name_of).eq(["loss", "loss_backward"]));
        let of = |kernel| super::resolve(kernel, source, &[], SHARED);
        assert_eq!((&*of("loss"), &*of("loss_backward")), ("a\nb\n", "a\nfn one() {}\nc\n"));
    }

    #[test]
    fn the_header_leaves_no_line() {
        assert_eq!(resolve("//! A kernel.\n#set train\n#stage other\n// How it works.\n"), "// How it works.\n");
    }

    #[test]
    fn a_definition_chooses_the_lines_of_its_variant() {
        let source = "#if A\na\n    #if B\nab\n    #endif\n#else\nb\n#endif\nc\n";
        assert_eq!(resolve(source), "b\nc\n");
        assert_eq!(resolve(&format!("#define A\n{source}")), "a\nc\n");
        assert_eq!(resolve(&format!("#define A\n#define B\n{source}")), "a\nab\nc\n");
        assert_eq!(resolve(&format!("#define B\n{source}")), "b\nc\n");
        assert_eq!(super::resolve("one", source, &["A"], SHARED), "a\nc\n");
    }

    #[test]
    #[should_panic(expected = "without #endif")]
    fn a_condition_has_an_end() {
        resolve("#if A\na\n");
    }
}
