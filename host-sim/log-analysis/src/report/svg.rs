//! SVG writer. Shapes have classes whose style is in `assets/picture.css`; its colours are variables for light and dark
//! schemes, which plotting libraries such as plotters do not support. Values that are not finite are not drawn.

use std::fmt::Write as _;

use super::text::escape_html;

const COLOURS_CSS: &str = include_str!("assets/colours.css");
const PICTURE_CSS: &str = include_str!("assets/picture.css");

/// Position in a picture, right and down.
pub type PicturePoint = [f64; 2];

/// Marker shape, distinguishable without colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkerShape {
    Circle,
    Triangle,
    Square,
    Diamond,
    /// A dot of the stroke's width; compact in large numbers.
    Dot,
}

pub struct Svg {
    size: PicturePoint,
    body: String,
}

impl Svg {
    pub const fn new(width: f64, height: f64) -> Self {
        Self { size: [width, height], body: String::new() }
    }

    pub fn draw_line(&mut self, class: &str, [x1, y1]: PicturePoint, [x2, y2]: PicturePoint) {
        if let Some([x1, y1, x2, y2]) = format_coordinates([x1, y1, x2, y2]) {
            self.push_element(&format!(r#"<line class="{class}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>"#));
        }
    }

    /// A rectangle from its upper left corner.
    pub fn draw_rectangle(&mut self, class: &str, [x, y]: PicturePoint, [width, height]: PicturePoint) {
        if let Some([x, y, width, height]) = format_coordinates([x, y, width.max(0.0), height.max(0.0)]) {
            self.push_element(&format!(r#"<rect class="{class}" x="{x}" y="{y}" width="{width}" height="{height}"/>"#));
        }
    }

    /// Text; the class sets its alignment at the position.
    pub fn draw_text(&mut self, class: &str, [x, y]: PicturePoint, text: &str) {
        if let Some([x, y]) = format_coordinates([x, y]) {
            self.push_element(&format!(r#"<text class="{class}" x="{x}" y="{y}">{}</text>"#, escape_html(text)));
        }
    }

    /// Text rotated to read upwards, centred.
    pub fn draw_vertical_text(&mut self, class: &str, [x, y]: PicturePoint, text: &str) {
        if let Some([x, y]) = format_coordinates([x, y]) {
            let text = escape_html(text);
            self.push_element(&format!(
                r#"<text class="{class}" transform="translate({x} {y}) rotate(-90)">{text}</text>"#
            ));
        }
    }

    /// A line through points, interrupted at `None`.
    pub fn draw_path(&mut self, class: &str, points: impl IntoIterator<Item = Option<PicturePoint>>) {
        let mut path_data = String::new();
        let mut is_down = false;
        for point in points {
            let Some([x, y]) = point.and_then(format_coordinates) else {
                is_down = false;
                continue;
            };
            // Writing to a string cannot fail.
            let _ = write!(path_data, "{}{x} {y}", if is_down { 'L' } else { 'M' });
            is_down = true;
        }
        if !path_data.is_empty() {
            self.push_element(&format!(r#"<path class="{class}" d="{path_data}"/>"#));
        }
    }

    /// Points of one class and shape as a single element.
    pub fn draw_points(
        &mut self,
        class: &str,
        shape: MarkerShape,
        radius: f64,
        points: impl IntoIterator<Item = PicturePoint>,
    ) {
        let mut path_data = String::new();
        for point in points {
            let Some([x, y]) = format_coordinates(point) else { continue };
            let Some([radius_text, diameter_text, height_text]) =
                format_coordinates([radius, 2.0 * radius, 1.15 * radius])
            else {
                continue;
            };
            let _ = match shape {
                MarkerShape::Dot => write!(path_data, "M{x} {y}h0"),
                MarkerShape::Circle => write!(
                    path_data,
                    "M{x} {y}m-{radius_text} 0a{radius_text} {radius_text} 0 1 0 {diameter_text} 0a{radius_text} {radius_text} 0 1 0-{diameter_text} 0"
                ),
                MarkerShape::Square => write!(
                    path_data,
                    "M{x} {y}m-{radius_text}-{radius_text}h{diameter_text}v{diameter_text}h-{diameter_text}z"
                ),
                MarkerShape::Triangle => write!(
                    path_data,
                    "M{x} {y}m0-{height_text}l{height_text} {diameter_text}h-{height_text}h-{height_text}z"
                ),
                MarkerShape::Diamond => write!(
                    path_data,
                    "M{x} {y}m0-{height_text}l{height_text} {height_text}l-{height_text} {height_text}l-{height_text}-{height_text}z"
                ),
            };
        }
        if !path_data.is_empty() {
            self.push_element(&format!(r#"<path class="{class}" d="{path_data}"/>"#));
        }
    }

    fn push_element(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }

    /// Element for a page with [`style_css`]. `id` must be unique in the page; title and words describe the picture to
    /// screen readers.
    pub fn to_inline(&self, id: &str, title: &str, description: &str) -> String {
        let [width, height] = self.size;
        let (title, description) = (escape_html(title), escape_html(description));
        format!(
            "<svg role=\"img\" viewBox=\"0 0 {width} {height}\" aria-labelledby=\"{id}-t {id}-d\">\
             <title id=\"{id}-t\">{title}</title><desc id=\"{id}-d\">{description}</desc>\n{}</svg>\n",
            self.body
        )
    }

    pub fn to_file(&self, title: &str, description: &str) -> String {
        let [width, height] = self.size;
        let (title, description) = (escape_html(title), escape_html(description));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" aria-labelledby=\"t d\">\n<title id=\"t\">{title}</title><desc id=\"d\">{description}\
             </desc>\n<style>\n{COLOURS_CSS}{PICTURE_CSS}</style>\n<rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n{}\
             </svg>\n",
            self.body
        )
    }
}

pub fn style_css() -> String {
    format!("{COLOURS_CSS}{PICTURE_CSS}")
}

/// Coordinates rounded to 0.1; none if any is not finite.
fn format_coordinates<const N: usize>(coordinates: [f64; N]) -> Option<[f64; N]> {
    // A value rounded to 0.1 prints with at most one decimal.
    coordinates
        .iter()
        .all(|number| number.is_finite())
        .then(|| coordinates.map(|number| (number * 10.0).round() / 10.0 + 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_finite_numbers_are_not_drawn() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.draw_line("a", [0.0, f64::NAN], [1.0, 1.0]);
        svg.draw_rectangle("a", [0.0, 0.0], [f64::INFINITY, 1.0]);
        svg.draw_text("a", [f64::NAN, 0.0], "words");
        svg.draw_vertical_text("a", [f64::NAN, 0.0], "words");
        svg.draw_points("a", MarkerShape::Circle, 1.0, [[f64::NAN, 1.0]]);
        svg.draw_path("a", [None, Some([f64::NAN, 1.0])]);
        assert_eq!(svg.body, "");
        svg.draw_path("a", [Some([0.0, 0.0]), Some([1.0, 1.0]), Some([f64::NAN, 2.0]), None, Some([3.04, -0.01])]);
        assert_eq!(svg.body, "<path class=\"a\" d=\"M0 0L1 1M3 0\"/>\n");
    }

    #[test]
    fn text_is_escaped_in_svg() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.draw_text("a", [0.0, 0.0], "<script>alert(1)</script>");
        for svg_text in [svg.to_inline("p", "<b>", "\"&"), svg.to_file("<b>", "\"&")] {
            assert!(!svg_text.contains("<script") && !svg_text.contains("<b>"), "{svg_text}");
            assert!(svg_text.contains("&lt;script&gt;") && svg_text.contains("&quot;&amp;"), "{svg_text}");
        }
    }
}
