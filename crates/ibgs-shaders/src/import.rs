//! `#import name` puts `wgsl/shared/name.wgsl` in place, once. After `#define NAME` the lines between `#if NAME` and its `#else` or
//! `#endif` count, without it those between `#else` and `#endif`: kernels that are variants of each other share one file. The lines
//! between `#repeat name count` and `#end` come `count` times, with the number of the repetition in place of `$name`: drivers do
//! not unroll every loop that they should.

const SHARED: &[(&str, &str)] = &[
    ("blend", include_str!("../wgsl/shared/blend.wgsl")),
    ("blend_backward", include_str!("../wgsl/shared/blend_backward.wgsl")),
    ("blend_backward_pixel", include_str!("../wgsl/shared/blend_backward_pixel.wgsl")),
    ("blend_backward_subgroups", include_str!("../wgsl/shared/blend_backward_subgroups.wgsl")),
    ("block", include_str!("../wgsl/shared/block.wgsl")),
    ("cover", include_str!("../wgsl/shared/cover.wgsl")),
    ("depth_normal", include_str!("../wgsl/shared/depth_normal.wgsl")),
    ("expose_params", include_str!("../wgsl/shared/expose_params.wgsl")),
    ("filter", include_str!("../wgsl/shared/filter.wgsl")),
    ("frame", include_str!("../wgsl/shared/frame.wgsl")),
    ("gaussian", include_str!("../wgsl/shared/gaussian.wgsl")),
    ("half", include_str!("../wgsl/shared/half.wgsl")),
    ("half_conv_tile", include_str!("../wgsl/shared/half_conv_tile.wgsl")),
    ("half_mlp", include_str!("../wgsl/shared/half_mlp.wgsl")),
    ("half_mlp_first", include_str!("../wgsl/shared/half_mlp_first.wgsl")),
    ("half_resize", include_str!("../wgsl/shared/half_resize.wgsl")),
    ("half_weights_tile", include_str!("../wgsl/shared/half_weights_tile.wgsl")),
    ("hash", include_str!("../wgsl/shared/hash.wgsl")),
    ("index", include_str!("../wgsl/shared/index.wgsl")),
    ("photo", include_str!("../wgsl/shared/photo.wgsl")),
    ("project", include_str!("../wgsl/shared/project.wgsl")),
    ("quaternion", include_str!("../wgsl/shared/quaternion.wgsl")),
    ("reduce", include_str!("../wgsl/shared/reduce.wgsl")),
    ("residual_conv_tile", include_str!("../wgsl/shared/residual_conv_tile.wgsl")),
    ("residual_difference", include_str!("../wgsl/shared/residual_difference.wgsl")),
    ("residual_feature", include_str!("../wgsl/shared/residual_feature.wgsl")),
    ("residual_features_main", include_str!("../wgsl/shared/residual_features_main.wgsl")),
    ("residual_features_rest", include_str!("../wgsl/shared/residual_features_rest.wgsl")),
    ("residual_head", include_str!("../wgsl/shared/residual_head.wgsl")),
    ("residual_head_kernel", include_str!("../wgsl/shared/residual_head_kernel.wgsl")),
    ("residual_image", include_str!("../wgsl/shared/residual_image.wgsl")),
    ("residual_input", include_str!("../wgsl/shared/residual_input.wgsl")),
    ("residual_mlp", include_str!("../wgsl/shared/residual_mlp.wgsl")),
    ("residual_mlp_layout", include_str!("../wgsl/shared/residual_mlp_layout.wgsl")),
    ("residual_output", include_str!("../wgsl/shared/residual_output.wgsl")),
    ("residual_source", include_str!("../wgsl/shared/residual_source.wgsl")),
    ("residual_weights_tile", include_str!("../wgsl/shared/residual_weights_tile.wgsl")),
    ("resize", include_str!("../wgsl/shared/resize.wgsl")),
    ("room", include_str!("../wgsl/shared/room.wgsl")),
    ("scan_block", include_str!("../wgsl/shared/scan_block.wgsl")),
    ("scan_length", include_str!("../wgsl/shared/scan_length.wgsl")),
    ("seen", include_str!("../wgsl/shared/seen.wgsl")),
    ("sh", include_str!("../wgsl/shared/sh.wgsl")),
    ("visible_params", include_str!("../wgsl/shared/visible_params.wgsl")),
    ("source", include_str!("../wgsl/shared/source.wgsl")),
    ("ssim", include_str!("../wgsl/shared/ssim.wgsl")),
    ("ssim_maps", include_str!("../wgsl/shared/ssim_maps.wgsl")),
    ("ssim_moments", include_str!("../wgsl/shared/ssim_moments.wgsl")),
    ("subgroup_sums", include_str!("../wgsl/shared/subgroup_sums.wgsl")),
    ("sum_rows", include_str!("../wgsl/shared/sum_rows.wgsl")),
    ("surface", include_str!("../wgsl/shared/surface.wgsl")),
    ("tile", include_str!("../wgsl/shared/tile.wgsl")),
    ("tile_order", include_str!("../wgsl/shared/tile_order.wgsl")),
];

/// The WGSL of a kernel's file: imports, variants and repetitions resolved; `defined`: names that are defined before it.
///
/// # Panics
/// When a kernel imports a file that does not exist, a condition or a repetition has no end, or a repetition no count: mistakes in
/// this crate, caught by its tests.
pub fn resolve(source: &str, defined: &[&str]) -> String {
    let mut expansion = Expansion { defined: defined.to_vec(), ..Expansion::default() };
    expansion.file(source);
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
        let parsed = repetition.split_once(' ').and_then(|(name, count)| Some((name, count.parse::<usize>().ok()?)));
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

#[derive(Default)]
struct Expansion<'a> {
    imported: Vec<&'a str>,
    defined: Vec<&'a str>,
    text: String,
}

impl<'a> Expansion<'a> {
    fn file(&mut self, source: &'a str) {
        // Whether the lines of each open condition count, and whether no `#else` has come yet.
        let mut conditions: Vec<(bool, bool)> = Vec::new();
        for line in source.lines() {
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
        let Some((_, text)) = SHARED.iter().find(|(file, _)| *file == name) else {
            panic!("WGSL import of unknown file {name}");
        };
        self.file(text);
    }
}

#[cfg(test)]
mod tests {
    fn resolve(source: &str) -> String {
        super::resolve(source, &[])
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
    fn imports_once() {
        let text = resolve("#import index\n#import index\nfn f() {}\n");
        assert_eq!(text.matches("fn linear_workgroup").count(), 1);
        assert!(text.ends_with("fn f() {}\n"));
    }

    #[test]
    fn a_definition_chooses_the_lines_of_its_variant() {
        let source = "#if A\na\n    #if B\nab\n    #endif\n#else\nb\n#endif\nc\n";
        assert_eq!(resolve(source), "b\nc\n");
        assert_eq!(resolve(&format!("#define A\n{source}")), "a\nc\n");
        assert_eq!(resolve(&format!("#define A\n#define B\n{source}")), "a\nab\nc\n");
        assert_eq!(resolve(&format!("#define B\n{source}")), "b\nc\n");
        assert_eq!(super::resolve(source, &["A"]), "a\nc\n");
    }

    #[test]
    #[should_panic(expected = "without #endif")]
    fn a_condition_has_an_end() {
        resolve("#if A\na\n");
    }
}
