//! Drawing of the errors by heading before and after the calibration, as SVG: it needs no script, and is a file, too.

use std::fmt::Write as _;

use super::model::{CompassReport, DeviationCurve};
use super::text::escape_html;
use crate::numbers::format_number;

const COLOURS_CSS: &str = include_str!("assets/colours.css");
const PICTURE_CSS: &str = include_str!("assets/picture.css");

/// Size of the drawing, and its margins beside and below the plot, pixels.
const SIZE: [f64; 2] = [440.0, 350.0];
const LEFT: f64 = 58.0;
const RIGHT: f64 = 16.0;
const BOTTOM: f64 = 44.0;
/// Size of a field of the legend.
const LEGEND_SIZE: [f64; 2] = [204.0, 18.0];

/// Classes of the lines before the calibration, distinguishable without colour; those after it are of one class.
const LINE_CLASSES: [&str; 3] = ["l l0", "l l1", "l l2"];
const AFTER_CLASS: &str = "l l3";

/// Style of the drawing on a page.
pub fn style_css() -> String {
    format!("{COLOURS_CSS}{PICTURE_CSS}")
}

/// The drawing, with its title and description.
pub struct DeviationPicture {
    pub title: &'static str,
    pub description: String,
    elements: String,
}

/// Range of the errors, and interval of the grid, degrees.
struct ErrorAxis {
    limit_deg: f64,
    step_deg: f64,
}

impl ErrorAxis {
    fn new(max_deg: f64) -> Self {
        let max_deg = max_deg.clamp(0.1, 180.0);
        let step_deg = match max_deg {
            90.0.. => 90.0,
            45.0.. => 30.0,
            _ => round_step(max_deg / 3.0),
        };
        Self { limit_deg: (max_deg / step_deg).ceil() * step_deg, step_deg }
    }
}

/// Smallest 1, 2 or 5 times a power of ten not less than `min_step`.
fn round_step(min_step: f64) -> f64 {
    let power = libm::pow(10.0, libm::log10(min_step).floor());
    [1.0, 2.0, 5.0]
        .map(|times| times * power)
        .into_iter()
        .find(|step| *step >= min_step * 0.999)
        .unwrap_or(10.0 * power)
}

/// Largest magnitude of the errors, degrees; zero without any.
fn max_error_deg(curves: &[DeviationCurve]) -> f64 {
    let errors = curves.iter().flat_map(|curve| curve.errors_deg.iter().copied().flatten());
    errors.filter(|error| error.is_finite()).map(f64::abs).fold(0.0, f64::max)
}

impl DeviationPicture {
    pub fn new(compass: &CompassReport, difference_name: &str) -> Self {
        let (before, after) = (&compass.curves_before, &compass.curves_after);
        let [max_before, max_after] = [before, after].map(|curves| max_error_deg(curves));
        let text = |deg: f64| format_number(deg, 1);
        let (title, description) = match (before.is_empty(), after.is_empty()) {
            (true, true) => ("Error by heading", "There is no reference heading.".to_owned()),
            (_, true) => ("Error by heading", format!("Largest {difference_name}: {} deg.", text(max_before))),
            (_, false) => (
                "Error by heading, before and after",
                format!("Largest {difference_name}: {} deg before, {} after.", text(max_before), text(max_after)),
            ),
        };
        let mut picture = Self { title, description, elements: String::new() };
        picture.text("title", [LEFT - 42.0, 20.0], title);
        let top = picture.draw_legend(compass);
        let axis = ErrorAxis::new(max_before.max(max_after));
        picture.draw_axes(top, &axis, &format!("{difference_name}, deg"));
        let classes = LINE_CLASSES.into_iter().cycle();
        for (curve, class) in before.iter().zip(classes).chain(after.iter().map(|curve| (curve, AFTER_CLASS))) {
            picture.draw_curve(top, &axis, &curve.errors_deg, class);
        }
        picture
    }

    /// Draws the names of the lines in two columns; returns the upper edge of the plot.
    fn draw_legend(&mut self, compass: &CompassReport) -> f64 {
        let named = |when: &str, curve: &DeviationCurve| format!("{when}: {}", curve.curve_name);
        let mut items: Vec<(&str, String)> =
            LINE_CLASSES.into_iter().zip(compass.curves_before.iter().map(|curve| named("before", curve))).collect();
        match &compass.curves_after[..] {
            [] => {}
            [only] => items.push((AFTER_CLASS, named("after", only))),
            _ => items.push((AFTER_CLASS, "after, the same banks".to_owned())),
        }
        for (i, (class, name)) in items.iter().enumerate() {
            let x = LEFT - 42.0 + LEGEND_SIZE[0] * (i % 2) as f64;
            let y = 39.0 + LEGEND_SIZE[1] * (i / 2) as f64;
            self.line(class, [x, y], [x + 24.0, y]);
            self.text("name", [x + 30.0, y + 4.0], name);
        }
        38.0 + LEGEND_SIZE[1] * items.len().div_ceil(2) as f64
    }

    fn draw_axes(&mut self, top: f64, axis: &ErrorAxis, name: &str) {
        let [left, right, bottom] = [LEFT, SIZE[0] - RIGHT, SIZE[1] - BOTTOM];
        for heading_deg in (0..=360).step_by(30) {
            let x = x_position(f64::from(heading_deg));
            self.line("grid", [x, top], [x, bottom]);
            if heading_deg % 90 == 0 {
                self.text("tick mid", [x, bottom + 17.0], &heading_deg.to_string());
            }
        }
        let decimals = if axis.step_deg >= 1.0 { 0 } else { 1 + usize::from(axis.step_deg < 0.09) };
        let line_count = (axis.limit_deg / axis.step_deg).round() as i32;
        for number in -line_count..=line_count {
            let error_deg = f64::from(number) * axis.step_deg;
            let y = y_position(top, axis, error_deg);
            self.line(if number == 0 { "zero" } else { "grid" }, [left, y], [right, y]);
            self.text("tick end", [left - 6.0, y + 4.0], &format_number(error_deg, decimals));
        }
        self.text("name mid", [left.midpoint(right), bottom + 34.0], "heading, deg");
        let (x, y) = (left - 43.0, top.midpoint(bottom));
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(
            self.elements,
            r#"<text class="name mid" transform="translate({x} {y:.1}) rotate(-90)">{}</text>"#,
            escape_html(name)
        );
    }

    /// Draws a closed line, interrupted at missing errors and at jumps across 180 deg; a point alone is a dot.
    fn draw_curve(&mut self, top: f64, axis: &ErrorAxis, errors_deg: &[Option<f64>], class: &str) {
        let step_deg = 360.0 / errors_deg.len().max(1) as f64;
        let mut last: Option<f64> = None;
        let mut path = String::new();
        for (i, error) in errors_deg.iter().chain(errors_deg.first()).enumerate() {
            let error = error.filter(|error| error.is_finite());
            if let Some(error) = error {
                let (x, y) = (x_position(i as f64 * step_deg), y_position(top, axis, error));
                let is_joined = last.is_some_and(|last| (error - last).abs() <= 180.0);
                let _ = if is_joined { write!(path, "L{x:.1} {y:.1}") } else { write!(path, "M{x:.1} {y:.1}h0") };
            }
            last = error;
        }
        let _ = writeln!(self.elements, r#"<path class="{class}" d="{path}"/>"#);
    }

    fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        let _ = writeln!(self.elements, r#"<path class="{class}" d="M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}"/>"#);
    }

    fn text(&mut self, class: &str, [x, y]: [f64; 2], text: &str) {
        let text = escape_html(text);
        let _ = writeln!(self.elements, r#"<text class="{class}" x="{x:.1}" y="{y:.1}">{text}</text>"#);
    }

    /// Element for a page with [`style_css`].
    pub fn inline(&self) -> String {
        let [width, height] = SIZE;
        let (title, description) = (self.title, escape_html(&self.description));
        format!(
            "<svg role=\"img\" viewBox=\"0 0 {width} {height}\" aria-labelledby=\"deviation-t deviation-d\">\
             <title id=\"deviation-t\">{title}</title><desc id=\"deviation-d\">{description}</desc>\n{}</svg>\n",
            self.elements
        )
    }

    /// File of the drawing, with its style and a background.
    pub fn file(&self) -> String {
        let [width, height] = SIZE;
        let root = format!("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\"");
        let background = format!(
            "<style>\n{}</style>\n<rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n",
            style_css()
        );
        self.inline().replacen("<svg", &root, 1).replacen("</desc>\n", &format!("</desc>\n{background}"), 1)
    }
}

fn x_position(heading_deg: f64) -> f64 {
    LEFT + heading_deg / 360.0 * (SIZE[0] - LEFT - RIGHT)
}

/// Vertical position of an error, clamped to the plot.
fn y_position(top: f64, axis: &ErrorAxis, error_deg: f64) -> f64 {
    let fraction = (error_deg / axis.limit_deg).clamp(-1.0, 1.0);
    top + (1.0 - fraction) / 2.0 * (SIZE[1] - BOTTOM - top)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(before: &[Option<f64>], after: &[Option<f64>]) -> DeviationPicture {
        let curves = |errors_deg: &[Option<f64>]| DeviationCurve {
            errors_deg: errors_deg.to_vec(),
            ..DeviationCurve::default()
        };
        let compass = CompassReport {
            curves_before: vec![curves(before)],
            curves_after: vec![curves(after)],
            ..CompassReport::default()
        };
        DeviationPicture::new(&compass, "error")
    }

    fn ticks(picture: &DeviationPicture) -> Vec<&str> {
        let ticks = picture.elements.lines().filter_map(|line| line.strip_prefix("<text class=\"tick end\""));
        ticks.filter_map(|line| line.split(['<', '>']).nth(1)).collect()
    }

    #[test]
    fn both_sets_of_errors_are_on_one_scale_of_round_numbers() {
        let both = picture(&[Some(20.0), Some(-18.0)], &[Some(0.4), Some(-0.2)]);
        assert_eq!(both.description, "Largest error: 20.0 deg before, 0.4 after.");
        for (max_deg, lowest, count) in
            [(21.7, "-30", 7), (0.8, "-1.0", 5), (0.0, "-0.10", 5), (50.0, "-60", 5), (170.0, "-180", 5)]
        {
            let picture = picture(&[Some(max_deg)], &[]);
            assert_eq!((ticks(&picture)[0], ticks(&picture).len()), (lowest, count), "{max_deg}");
        }
    }

    #[test]
    fn a_line_is_closed_and_broken_at_missing_errors_and_jumps() {
        let errors = [Some(90.0), Some(0.0), None, Some(170.0), Some(-170.0), Some(f64::NAN)];
        let picture = picture(&errors, &[]);
        let path =
            picture.elements.lines().filter_map(|line| line.strip_prefix("<path class=\"l l0\" d=\"")).next_back();
        let commands: String = path.unwrap().chars().filter(char::is_ascii_alphabetic).collect();
        assert!(commands.starts_with("MhLMhMhMh"), "{commands}");
        assert!(path.unwrap().contains(&format!("M{:.1} ", x_position(360.0))), "{path:?}");
    }
}
