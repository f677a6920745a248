//! Building blocks of the HTML pages. Each page is one file that loads nothing else.

use ibgs_core::picture::web::{WORST, error_color};
use std::fmt::Write;

/// Stands for an unknown value.
pub const NONE: &str = "–";

/// Escapes text for HTML, attributes included.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            c => safe.push(c),
        }
    }
    safe
}

/// A whole page; `body` is HTML.
pub fn document(title: &str, body: &str) -> String {
    let (title, style, script) = (escape(title), include_str!("page.css"), include_str!("page.js"));
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{style}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n{body}</main>\n\
         <script>\n{script}</script>\n</body>\n</html>\n"
    )
}

/// A section with a heading; nothing if the content is empty.
pub fn section(heading: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    format!("<section>\n<h2>{}</h2>\n{content}</section>\n", escape(heading))
}

/// A number with this many decimals.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.filter(|value| value.is_finite()).map_or_else(|| NONE.to_owned(), |value| format!("{value:.decimals$}"))
}

/// A cell of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cell {
    /// Its text.
    pub text: String,
    /// Whether it is the best of its column.
    pub best: bool,
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self { text, best: false }
    }
}

/// A table whose first column names the rows.
pub fn table(head: &[&str], rows: &[Vec<Cell>]) -> String {
    let titles: String = head.iter().map(|title| format!("<th scope=\"col\">{}</th>", escape(title))).collect();
    let mut html = format!("<div class=\"scroll\"><table>\n<thead><tr>{titles}</tr></thead>\n<tbody>\n");
    for row in rows {
        html += "<tr>";
        for (column, Cell { text, best }) in row.iter().enumerate() {
            let text = escape(text);
            let _ = match (column, best) {
                (0, _) => write!(html, "<th scope=\"row\">{text}</th>"),
                (_, true) => write!(html, "<td class=\"best\">{text}</td>"),
                (_, false) => write!(html, "<td>{text}</td>"),
            };
        }
        html += "</tr>\n";
    }
    html + "</tbody>\n</table></div>\n"
}

/// Names and values, one row each; nothing without any.
pub fn list(rows: &[(String, String)]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let rows = rows.iter().map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(value)));
    format!("<dl>\n{}</dl>\n", rows.collect::<String>())
}

/// The colour scale of the error pictures.
pub fn error_scale() -> String {
    let stop = |i: i32| {
        let [r, g, b] = error_color(f64::from(i) / 10.0);
        format!("rgb({r},{g},{b})")
    };
    let stops: Vec<String> = (0..=10).map(stop).collect();
    let labels = (0..=4).map(|i| f64::from(i) / 4.0 * WORST);
    let labels: String = labels.map(|value| format!("<span>{value:.2}</span>")).collect();
    format!(
        "<figure class=\"scale\"><div style=\"background:linear-gradient(90deg,{})\"></div>\n<div class=\"ticks\">{labels}</div>\n\
         <figcaption>Error pictures: mean absolute error over red, green and blue in a range of 0 to 1; \
         {WORST:.2} and more is brightest, masked pixels are black. \
         The residual, final minus base image, is shown around grey.</figcaption></figure>\n",
        stops.join(",")
    )
}

/// One of several pictures of a view, which lie on top of each other.
pub struct Layer {
    /// Its kind, named alike in every view.
    pub kind: &'static str,
    /// Its `data:` URI.
    pub uri: String,
}

/// The pictures of one view on top of each other, with a divider between the two that are selected; nothing without
/// pictures.
pub fn stage(name: &str, [width, height]: [u32; 2], layers: &[Layer], shown: [&str; 2]) -> String {
    if layers.is_empty() {
        return String::new();
    }
    let name = escape(name);
    let crisp = if width < 320 { " crisp" } else { "" };
    let mut html = format!("<div class=\"stage{crisp}\" style=\"aspect-ratio:{width}/{height}\">\n");
    for Layer { kind, uri } in layers {
        let class = ["l", "r"].into_iter().zip(shown).find(|(_, shown)| shown == kind).map_or("", |(class, _)| class);
        let _ = writeln!(
            html,
            "<img class=\"{class}\" data-kind=\"{kind}\" alt=\"{kind}, {name}\" decoding=\"async\" src=\"{uri}\">"
        );
    }
    let [left, right] = shown;
    html + &format!(
        "<i></i><span class=\"tag left\">{left}</span><span class=\"tag right\">{right}</span>\n\
         <input type=\"range\" min=\"0\" max=\"100\" step=\"0.1\" value=\"50\" aria-label=\"Divider, {name}\">\n</div>\n"
    )
}

/// Selects the two pictures that every stage shows.
pub fn chooser(kinds: &[&str], shown: [&str; 2]) -> String {
    let select = |side: &str, label: &str, shown: &str| {
        let option = |kind: &&str| {
            let selected = if *kind == shown { " selected" } else { "" };
            format!("<option value=\"{kind}\"{selected}>{kind}</option>")
        };
        let options: String = kinds.iter().map(option).collect();
        format!("<label>{label} <select id=\"{side}\">{options}</select></label>\n")
    };
    let [left, right] = shown;
    format!(
        "<div class=\"choose\">{}{}<span class=\"hint\">Move over a picture, or drag, to compare.</span></div>\n",
        select("left", "Left", left),
        select("right", "Right", right)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_name_holds_is_markup() {
        let name = "\"><img src=x onerror='alert(1)'>&";
        let safe = "&quot;&gt;&lt;img src=x onerror=&#39;alert(1)&#39;&gt;&amp;";
        assert_eq!(escape(name), safe);
        let layer = Layer { kind: "photo", uri: "data:x".to_owned() };
        let pages = [
            table(&[name], &[vec![Cell::from(name.to_owned()), Cell { text: name.to_owned(), best: true }]]),
            list(&[(name.to_owned(), name.to_owned())]),
            document(name, &section(name, "x")),
            stage(name, [4, 3], &[layer], ["photo", "final"]),
        ];
        for page in pages {
            assert!(page.contains(safe) && !page.contains("<img src=x"), "{page}");
        }
    }
}
