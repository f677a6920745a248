//! Line plots as SVG in a page.

use super::page::escape;
use std::fmt::Write;

/// Size in SVG units.
const SIZE: [f64; 2] = [480.0, 300.0];
/// Space left of, right of, above and below the plot.
const MARGIN: [f64; 4] = [56.0, 14.0, 14.0, 46.0];

/// A curve.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Its points, from left to right.
    pub points: Vec<[f64; 2]>,
    /// Whether to mark each point; for curves of few points.
    pub marked: bool,
}

/// A plot of some curves.
pub struct Plot {
    /// Title above the plot.
    pub title: &'static str,
    /// Name of the horizontal axis.
    pub x: &'static str,
    /// Name of the vertical axis.
    pub y: &'static str,
    /// The curves; empty ones are left out.
    pub series: Vec<Series>,
}

/// An axis: its ends and its ticks.
struct Axis {
    from: f64,
    to: f64,
    ticks: Vec<f64>,
}

impl Axis {
    /// An axis with round ends that contains all values.
    fn around(values: impl Iterator<Item = f64> + Clone) -> Self {
        let (low, high) = (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max));
        let span = if high > low { high - low } else { high.abs().max(1.0) };
        let raw = span / 4.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|f| f * power).into_iter().find(|step| *step >= raw).unwrap_or(raw);
        let (first, last) = ((low / step).floor(), (high / step).ceil().max((low / step).floor() + 1.0));
        let ticks = (0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect();
        Self { from: first * step, to: last * step, ticks }
    }

    fn part(&self, value: f64) -> f64 {
        (value - self.from) / (self.to - self.from)
    }

    /// Short labels of the ticks, all in the same form.
    fn labels(&self) -> Vec<String> {
        let most = self.ticks.iter().fold(0f64, |most, tick| most.max(tick.abs()));
        let (unit, suffix) = match most {
            most if most >= 1e6 => (1e6, "M"),
            most if most >= 1e4 => (1e3, "k"),
            _ => (1.0, ""),
        };
        let step = (self.ticks[1] - self.ticks[0]) / unit;
        let decimals = (-(step + 1e-12).log10().floor()).max(0.0) as usize;
        let label = |tick: &f64| match *tick {
            zero if zero == 0.0 && decimals == 0 => "0".to_owned(),
            tick => format!("{:.decimals$}{suffix}", tick / unit),
        };
        self.ticks.iter().map(label).collect()
    }
}

impl Plot {
    /// The plot as HTML; empty if no curve has a point.
    pub fn html(&self) -> String {
        // A curve's colour does not depend on which others are shown.
        let shown: Vec<(usize, &Series)> =
            self.series.iter().enumerate().filter(|(_, series)| !series.points.is_empty()).collect();
        if shown.is_empty() {
            return String::new();
        }
        let along = |axis: usize| shown.iter().flat_map(|(_, s)| &s.points).map(move |point| point[axis]);
        let [x, y] = [Axis::around(along(0)), Axis::around(along(1))];
        let mut svg = self.frame(&x, &y);
        for (number, series) in &shown {
            curve(&mut svg, series, *number, &x, &y);
        }
        let legend: String = shown.iter().map(|(number, s)| legend(*number, &s.name)).collect();
        format!(
            "<figure class=\"plot\"><h3>{}</h3>\n{svg}</svg>\n<figcaption>{legend}</figcaption></figure>\n",
            escape(self.title)
        )
    }

    /// Axes with their labels.
    fn frame(&self, x: &Axis, y: &Axis) -> String {
        let [width, height] = SIZE;
        let [left, right, top, bottom] = [MARGIN[0], width - MARGIN[1], MARGIN[2], height - MARGIN[3]];
        let (title, x_name, y_name) = (escape(self.title), escape(self.x), escape(self.y));
        let mut svg = format!("<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">\n");
        for (tick, label) in x.ticks.iter().zip(x.labels()) {
            let at = place(x, y, [*tick, y.from])[0];
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{at:.1} {top}V{bottom}\"/>");
            let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", bottom + 17.0);
        }
        for (tick, label) in y.ticks.iter().zip(y.labels()) {
            let at = place(x, y, [x.from, *tick])[1];
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{left} {at:.1}H{right}\"/>");
            let _ =
                writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", left - 7.0, at + 4.0);
        }
        let (middle_x, middle_y) = (0.5 * (left + right), 0.5 * (top + bottom));
        let _ = writeln!(svg, "<path class=\"axis\" d=\"M{left} {top}V{bottom}H{right}\"/>");
        let _ = writeln!(svg, "<text x=\"{middle_x}\" y=\"{}\" text-anchor=\"middle\">{x_name}</text>", height - 8.0);
        let turned = format!("transform=\"translate(13 {middle_y}) rotate(-90)\"");
        let _ = writeln!(svg, "<text {turned} text-anchor=\"middle\">{y_name}</text>");
        svg
    }
}

/// Plots side by side as HTML; empty if no curve has a point.
pub fn beside(plots: &[Plot]) -> String {
    let plots: String = plots.iter().map(Plot::html).collect();
    if plots.is_empty() { plots } else { format!("<div class=\"plots\">\n{plots}</div>\n") }
}

/// The position of a point in the drawing.
fn place(x: &Axis, y: &Axis, [px, py]: [f64; 2]) -> [f64; 2] {
    let [left, right, top, bottom] = MARGIN;
    let (width, height) = (SIZE[0] - left - right, SIZE[1] - top - bottom);
    [left + width * x.part(px), top + height * (1.0 - y.part(py))]
}

fn curve(svg: &mut String, series: &Series, number: usize, x: &Axis, y: &Axis) {
    let color = number % 6;
    let points: Vec<[f64; 2]> = series.points.iter().map(|&point| place(x, y, point)).collect();
    if points.len() > 1 {
        let path: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(svg, "<polyline class=\"c{color}\" points=\"{}\"/>", path.join(" "));
    }
    if series.marked || points.len() == 1 {
        for [x, y] in points {
            let _ = writeln!(svg, "<circle class=\"c{color}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\"/>");
        }
    }
}

fn legend(number: usize, name: &str) -> String {
    let color = number % 6;
    format!(
        "<span class=\"key\"><svg viewBox=\"0 0 18 8\"><path class=\"c{color}\" d=\"M0 4H18\"/></svg>{}</span>",
        escape(name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(values: &[f64]) -> Axis {
        Axis::around(values.iter().copied())
    }

    #[test]
    fn axes_end_on_round_values() {
        let psnr = axis(&[18.3, 27.9]);
        assert_eq!((psnr.ticks.as_slice(), psnr.labels()[0].as_str()), (&[15.0, 20.0, 25.0, 30.0][..], "15"));
        assert_eq!(axis(&[40.0, 29_960.0]).labels(), ["0", "10k", "20k", "30k"]);
        assert_eq!(axis(&[0.01, 0.19]).labels(), ["0.00", "0.05", "0.10", "0.15", "0.20"]);
        // One value, and zero alone, still make an axis.
        for single in [axis(&[7.0]), axis(&[0.0])] {
            assert!(single.to > single.from && single.ticks.len() >= 2);
        }
    }

    #[test]
    fn curves_stay_inside_and_empty_ones_away() {
        let series =
            |name: &str, points: &[[f64; 2]]| Series { name: name.into(), points: points.to_vec(), marked: true };
        let plot = |series| Plot { title: "t", x: "x", y: "y", series };
        assert_eq!(plot(vec![series("a", &[])]).html(), "");
        let html = plot(vec![series("none", &[]), series("a<b", &[[0.0, 5.0], [100.0, 9.0]])]).html();
        assert!(
            html.contains("a&lt;b") && !html.contains("none") && html.matches("<circle class=\"c1\"").count() == 2,
            "{html}"
        );
        let (x, y) = (axis(&[0.0, 100.0]), axis(&[5.0, 9.0]));
        assert_eq!(place(&x, &y, [x.from, y.from]), [MARGIN[0], SIZE[1] - MARGIN[3]]);
        assert_eq!(place(&x, &y, [x.to, y.to]), [SIZE[0] - MARGIN[1], MARGIN[2]]);
    }
}
