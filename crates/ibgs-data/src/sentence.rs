//! Words of sentences, and errors in one line.

use std::error::Error;
use std::fmt;

/// Most characters of a sentence: names in a damaged file may be of any length.
const MOST_CHARACTERS: usize = 2000;

/// A number of things: `1 photo`, `2 photos`.
pub fn counted<N: fmt::Display + PartialEq + From<u8>>(count: N, thing: &str) -> String {
    let ending = if count == N::from(1) { "" } else { "s" };
    format!("{count} {thing}{ending}")
}

/// The first of some names: `a, b, ...`.
pub fn first_of(names: &[impl AsRef<str>], most: usize) -> String {
    let dots = if names.len() > most { ", ..." } else { "" };
    let first: Vec<&str> = names.iter().take(most).map(AsRef::as_ref).collect();
    first.join(", ") + dots
}

/// An error in one line, with the causes that its own text does not contain yet. Control characters are replaced: a
/// name in a file may hold anything, even escape codes of a terminal.
pub fn sentence(error: &(dyn Error + 'static)) -> String {
    sentence_with(error, &|error| error.to_string())
}

/// As [`sentence`], but with texts from `words` in place of the errors' own; it formats one error without its causes.
pub fn sentence_with(error: &(dyn Error + 'static), words: &dyn Fn(&(dyn Error + 'static)) -> String) -> String {
    let mut text = words(error);
    let mut next = error.source();
    while let Some(cause) = next {
        if !text.contains(&cause.to_string()) {
            text = format!("{text}: {}", words(cause));
        }
        next = cause.source();
    }
    let plain = |c: char| match c {
        '\n' | '\r' | '\t' => " ".to_owned(),
        c if c.is_control() => c.escape_default().to_string(),
        c => c.to_string(),
    };
    match text.char_indices().nth(MOST_CHARACTERS) {
        Some((end, _)) => text[..end].chars().map(plain).chain(["...".to_owned()]).collect(),
        None => text.chars().map(plain).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_has_no_plural() {
        assert_eq!(
            [0_u32, 1, 2].map(|count| counted(count, "test view")),
            ["0 test views", "1 test view", "2 test views"]
        );
    }

    #[derive(Debug, thiserror::Error)]
    #[error("{text}")]
    struct Failure {
        text: &'static str,
        source: Option<Box<Failure>>,
    }

    #[test]
    fn causes_follow_in_one_line_without_control_characters() {
        let inner = Failure { text: "no\tspace\nleft", source: None };
        let named = Failure { text: "left: no\tspace\nleft", source: Some(Box::new(inner)) };
        let outer = Failure { text: "not written\u{1b}[2J", source: Some(Box::new(named)) };
        assert_eq!(sentence(&outer), "not written\\u{1b}[2J: left: no space left");
        let text: &'static str = Box::leak("x".repeat(5000).into_boxed_str());
        assert_eq!(sentence(&Failure { text, source: None }).len(), MOST_CHARACTERS + 3);
    }
}
