//! The tag of Gaussians that were trained with antialiasing, in the header of a PLY file.
//!
//! Brush writes `comment SplatRenderMode: mip`, Postshot `comment antialiased 1`. Without a tag they were not.

/// The line of a header; empty without antialiasing.
pub(super) fn line(antialiased: bool) -> &'static str {
    if antialiased { "comment SplatRenderMode: mip\n" } else { "" }
}

/// Whether the last tag of a whole header says antialiasing.
pub(super) fn find(header: &[u8]) -> bool {
    let text = String::from_utf8_lossy(header);
    let tag = |line: &str| match line.split_whitespace().collect::<Vec<_>>().as_slice() {
        ["comment", "SplatRenderMode:", mode] => Some(*mode == "mip"),
        ["comment", "antialiased", value @ ("0" | "1")] => Some(*value == "1"),
        _ => None,
    };
    text.lines().take_while(|line| *line != "end_header").filter_map(tag).last().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_of_other_programs() {
        assert!(find(format!("ply\n{}end_header\n", line(true)).as_bytes()) && line(false).is_empty());
        for (header, expected) in [
            ("comment SplatRenderMode: mip\r\n", true),
            ("comment SplatRenderMode: default\n", false),
            ("comment antialiased 1\n", true),
            ("comment antialiased 1\ncomment antialiased 0\n", false),
            ("comment antialiased by hand\n", false),
            ("end_header\ncomment antialiased 1\n", false),
        ] {
            assert_eq!(find(format!("ply\n{header}").as_bytes()), expected, "{header:?}");
        }
    }
}
