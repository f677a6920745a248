//! The text of OpenUSD layers, as far as [`super::usda_read`] needs it: prims, their kinds, and properties with numbers.

use std::collections::HashMap;

/// Prims below one another.
const MOST_DEPTH: usize = 64;

/// A prim, with the properties that were asked for.
#[derive(Debug, Default)]
pub(super) struct Prim {
    /// Its kind; empty where the layer does not say it.
    pub(super) kind: String,
    pub(super) properties: HashMap<String, Value>,
    pub(super) children: Vec<Prim>,
}

/// The numbers or the strings of a property, without its brackets.
#[derive(Debug, Default)]
pub(super) struct Value {
    pub(super) numbers: Vec<f64>,
    pub(super) strings: Vec<String>,
}

/// A layer.
#[derive(Debug)]
pub(super) struct Layer {
    /// Whether z points up, not y.
    pub(super) is_z_up: bool,
    pub(super) prims: Vec<Prim>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    /// A bracket, `=`, `,`, `;` or `:`.
    Mark(u8),
    /// A name, a number or a type.
    Word(&'a str),
    /// What stands between quotation marks, or a path or asset.
    Quoted(&'a str),
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    /// Which properties are kept.
    wanted: &'a dyn Fn(&str) -> bool,
}

/// Parses a layer, with the properties whose names are `wanted`.
///
/// # Errors
/// What is wrong, and in which line.
pub(super) fn parse(text: &str, wanted: &dyn Fn(&str) -> bool) -> Result<Layer, String> {
    let mut reader = Reader { text, at: 0, wanted };
    let mut layer = Layer { is_z_up: false, prims: Vec::new() };
    if reader.peek()? == Some(Token::Mark(b'(')) {
        let start = reader.at;
        reader.skip_value()?;
        layer.is_z_up = is_z_up(&text[start..reader.at], wanted)?;
    }
    while let Some(token) = reader.next()? {
        match token {
            Token::Word("def" | "over" | "class") => layer.prims.extend(reader.prim(token, 0)?),
            Token::Mark(b';') => {}
            _ => return Err(reader.wrong("is no prim")),
        }
    }
    Ok(layer)
}

/// Whether the metadata of a layer have `upAxis = "Z"`.
fn is_z_up(metadata: &str, wanted: &dyn Fn(&str) -> bool) -> Result<bool, String> {
    let mut reader = Reader { text: metadata, at: 0, wanted };
    while let Some(token) = reader.next()? {
        if token == Token::Word("upAxis") && reader.next()? == Some(Token::Mark(b'=')) {
            return Ok(reader.next()? == Some(Token::Quoted("Z")));
        }
    }
    Ok(false)
}

impl<'a> Reader<'a> {
    fn wrong(&self, what: &str) -> String {
        let line = self.text[..self.at.min(self.text.len())].matches('\n').count() + 1;
        format!("line {line} {what}")
    }

    /// Skips spaces and comments; whether a line ended among them.
    fn skip_spaces(&mut self) -> bool {
        let bytes = self.text.as_bytes();
        let mut ended = false;
        while let Some(&byte) = bytes.get(self.at) {
            match byte {
                b'#' => self.at += self.text[self.at..].find('\n').unwrap_or(self.text.len() - self.at),
                _ if byte.is_ascii_whitespace() => {
                    ended |= byte == b'\n';
                    self.at += 1;
                }
                _ => break,
            }
        }
        ended
    }

    fn peek(&mut self) -> Result<Option<Token<'a>>, String> {
        self.skip_spaces();
        let at = self.at;
        let token = self.next();
        self.at = at;
        token
    }

    fn next(&mut self) -> Result<Option<Token<'a>>, String> {
        self.skip_spaces();
        let rest = &self.text[self.at..];
        let Some(first) = rest.bytes().next() else { return Ok(None) };
        let token = match first {
            b'(' | b')' | b'[' | b']' | b'{' | b'}' | b'=' | b',' | b';' => {
                self.at += 1;
                Token::Mark(first)
            }
            b'"' | b'\'' => self.quoted(first)?,
            b'@' | b'<' => {
                let end = if first == b'@' { '@' } else { '>' };
                let length = rest[1..].find(end).ok_or_else(|| self.wrong("has a path that does not end"))?;
                self.at += length + 2;
                Token::Quoted(&rest[1..=length])
            }
            _ => {
                let is_end = |c: char| c.is_whitespace() || "()[]{}=,;\"'@<#".contains(c);
                let length = rest.find(is_end).unwrap_or(rest.len());
                if length == 0 {
                    return Err(self.wrong("has a character that no layer has"));
                }
                self.at += length;
                Token::Word(&rest[..length])
            }
        };
        Ok(Some(token))
    }

    /// A string, whose quotation marks may be three each.
    fn quoted(&mut self, mark: u8) -> Result<Token<'a>, String> {
        let rest = &self.text[self.at..];
        let triple = [mark; 3];
        let mark = if rest.as_bytes().starts_with(&triple) { &triple[..] } else { &triple[..1] };
        let mut at = mark.len();
        loop {
            match rest.as_bytes().get(at) {
                None => return Err(self.wrong("has a string that does not end")),
                Some(b'\\') => at += 2,
                Some(_) if rest.as_bytes()[at..].starts_with(mark) => break,
                Some(_) => at += 1,
            }
        }
        self.at += at + mark.len();
        // Both ends lie beside quotation marks, which are whole characters.
        Ok(Token::Quoted(&rest[mark.len()..at]))
    }

    /// A prim after its specifier; none where only its name is said.
    fn prim(&mut self, specifier: Token, depth: usize) -> Result<Option<Prim>, String> {
        if depth > MOST_DEPTH {
            return Err(self.wrong(&format!("has more than {MOST_DEPTH} prims below one another")));
        }
        let mut prim = Prim::default();
        loop {
            match self.next()? {
                Some(Token::Word(word)) => word.clone_into(&mut prim.kind),
                Some(Token::Quoted(_)) => break,
                _ => return Err(self.wrong("has a prim without a name")),
            }
        }
        if self.peek()? == Some(Token::Mark(b'(')) {
            self.skip_value()?;
        }
        if self.next()? != Some(Token::Mark(b'{')) {
            return Err(self.wrong("has a prim without `{`"));
        }
        self.body(&mut prim, depth)?;
        // What is a class is there to be inherited from.
        Ok((specifier == Token::Word("def")).then_some(prim))
    }

    fn body(&mut self, prim: &mut Prim, depth: usize) -> Result<(), String> {
        loop {
            match self.next()? {
                None => return Err(self.wrong("ends within a prim")),
                Some(Token::Mark(b'}')) => return Ok(()),
                Some(Token::Mark(b';')) => {}
                Some(token @ Token::Word("def" | "over" | "class")) => {
                    prim.children.extend(self.prim(token, depth + 1)?);
                }
                Some(Token::Word(first)) => self.property(first, prim)?,
                Some(_) => return Err(self.wrong("has no property where one must be")),
            }
        }
    }

    /// A property after its first word.
    fn property(&mut self, first: &'a str, prim: &mut Prim) -> Result<(), String> {
        let mut name = first;
        while !self.skip_spaces() {
            match self.peek()? {
                Some(Token::Word(word)) => {
                    name = word;
                    self.next()?;
                }
                Some(Token::Mark(b'[' | b']') | Token::Quoted(_)) => {
                    self.next()?;
                }
                _ => break,
            }
        }
        if self.peek()? == Some(Token::Mark(b'=')) {
            self.next()?;
            if (self.wanted)(name) {
                let value = self.value().map_err(|reason| format!("{reason} (`{name}`)"))?;
                prim.properties.insert(name.to_owned(), value);
            } else {
                self.skip_value()?;
            }
        }
        if self.peek()? == Some(Token::Mark(b'(')) {
            self.skip_value()?;
        }
        Ok(())
    }

    fn value(&mut self) -> Result<Value, String> {
        let mut value = Value::default();
        let mut depth = 0_usize;
        loop {
            match self.next()? {
                Some(Token::Mark(b'(' | b'[')) => depth += 1,
                Some(Token::Mark(b')' | b']')) if depth > 0 => depth -= 1,
                Some(Token::Mark(b',')) if depth > 0 => continue,
                Some(Token::Quoted(string)) => value.strings.push(string.to_owned()),
                Some(Token::Word("None")) => {}
                Some(Token::Word(word)) => {
                    let number =
                        word.parse().map_err(|_| self.wrong(&format!("has `{word}` where a number must be")))?;
                    value.numbers.push(number);
                }
                _ => return Err(self.wrong("has a value that is no list of numbers")),
            }
            if depth == 0 {
                return Ok(value);
            }
        }
    }

    /// Skips a value: a word, a string, or all between brackets.
    fn skip_value(&mut self) -> Result<(), String> {
        let mut depth = 0_usize;
        loop {
            match self.next()? {
                None => return Err(self.wrong("ends within a value")),
                Some(Token::Mark(b'(' | b'[' | b'{')) => depth += 1,
                Some(Token::Mark(b')' | b']' | b'}')) => {
                    depth = depth.checked_sub(1).ok_or_else(|| self.wrong("closes a bracket that is not open"))?;
                }
                Some(_) => {}
            }
            if depth == 0 {
                return Ok(());
            }
        }
    }
}
