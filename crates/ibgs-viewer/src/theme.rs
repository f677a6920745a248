//! How the window looks and is clicked: text large enough to be read, with enough contrast on every ground.

use eframe::egui::{Color32, Context, FontFamily, FontId, Style, TextStyle, Theme, Visuals};

/// Sizes of text in points.
const SIZES: [(TextStyle, f32, FontFamily); 5] = [
    (TextStyle::Small, 12.0, FontFamily::Proportional),
    (TextStyle::Body, 14.0, FontFamily::Proportional),
    (TextStyle::Button, 14.0, FontFamily::Proportional),
    (TextStyle::Heading, 18.0, FontFamily::Proportional),
    (TextStyle::Monospace, 13.0, FontFamily::Monospace),
];
/// Grey of text, and of text that matters less.
const DARK: [u8; 2] = [200, 165];
const LIGHT: [u8; 2] = [50, 90];
/// Factor of a bright colour where it is text on a light ground.
const DEEPER: f32 = 0.42;

/// Gives a window its text and its clicks.
pub fn apply(ctx: &Context) {
    for theme in [Theme::Dark, Theme::Light] {
        ctx.style_mut_of(theme, |style| write(style, theme));
    }
    // Where the frames of a slow driver come seconds apart, a button is pressed and released in two of them.
    ctx.options_mut(|options| options.input_options.max_click_duration = f64::INFINITY);
}

fn write(style: &mut Style, theme: Theme) {
    let [text, weak] = if theme == Theme::Dark { DARK } else { LIGHT };
    style.text_styles.extend(SIZES.map(|(name, size, family)| (name, FontId::new(size, family))));
    style.visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(text);
    style.visuals.weak_text_color = Some(Color32::from_gray(weak));
    style.visuals.warn_fg_color = as_text(Color32::from_rgb(255, 170, 60), &style.visuals);
    style.visuals.error_fg_color = as_text(Color32::from_rgb(255, 110, 100), &style.visuals);
}

/// A bright colour as text.
pub fn as_text(color: Color32, visuals: &Visuals) -> Color32 {
    let [r, g, b] = [color.r(), color.g(), color.b()].map(|value| (f32::from(value) * DEEPER) as u8);
    if visuals.dark_mode { color } else { Color32::from_rgb(r, g, b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::marks::{HELD_OUT, SOURCE, TRAINED};
    use eframe::egui::Rgba;

    /// Ratio of luminances (WCAG 2.2, 1.4.3).
    fn contrast(a: Color32, b: Color32) -> f32 {
        let luminance = |color: Color32| {
            let linear = Rgba::from(color);
            0.2126 * linear.r() + 0.7152 * linear.g() + 0.0722 * linear.b()
        };
        let [low, high] = {
            let (a, b) = (luminance(a), luminance(b));
            [a.min(b), a.max(b)]
        };
        (high + 0.05) / (low + 0.05)
    }

    #[test]
    fn all_text_can_be_read() {
        assert!((contrast(Color32::BLACK, Color32::WHITE) - 21.0).abs() < 1e-3);
        for theme in [Theme::Dark, Theme::Light] {
            let mut style = theme.default_style();
            write(&mut style, theme);
            assert!(style.text_styles.values().all(|font| font.size >= 12.0));
            let visuals = &style.visuals;
            let widgets = &visuals.widgets;
            let texts =
                [visuals.text_color(), visuals.weak_text_color(), visuals.error_fg_color, visuals.warn_fg_color]
                    .into_iter()
                    .chain([TRAINED, HELD_OUT, SOURCE].map(|color| as_text(color, visuals)))
                    .map(|text| (text, visuals.panel_fill));
            let buttons = [&widgets.inactive, &widgets.hovered, &widgets.active, &widgets.open]
                .map(|widget| (widget.text_color(), widget.weak_bg_fill));
            let chosen = (visuals.selection.stroke.color, visuals.selection.bg_fill);
            for (text, ground) in texts.chain(buttons).chain([chosen]) {
                assert!(contrast(text, ground) >= 4.5, "{theme:?}: {text:?} on {ground:?}: {}", contrast(text, ground));
            }
        }
    }
}
