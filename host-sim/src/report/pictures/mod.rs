//! The pictures of a page, a file each.

pub mod coverage;
pub mod field;
pub mod map;
pub mod methods;
pub mod swing;
pub mod time;

use super::svg::{At, Shape, Svg};

/// A picture with what is said of it.
pub struct Picture {
    /// The drawing.
    pub svg: Svg,
    /// Its title.
    pub title: String,
    /// What it shows, for one who does not see it and for one who does.
    pub words: String,
    /// Whether it needs the width of the page.
    pub is_wide: bool,
}

/// How something is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// A line of a class.
    Line(&'static str),
    /// Points of a shape and a class.
    Points(Shape, &'static str),
    /// A line with points.
    Both(&'static str, Shape, &'static str),
    /// An area of a class.
    Area(&'static str),
}

const ROW: f64 = 18.0;

/// Says how things are drawn, above them and never over them: as many rows as it takes. Gives the place below it.
pub fn legend(svg: &mut Svg, [left, top]: At, width: f64, items: &[(Key, &str)]) -> f64 {
    const SAMPLE: f64 = 24.0;
    let (mut x, mut y) = (left, top);
    for (key, name) in items {
        // No letter is wider in the mean, on a narrow screen neither, where they are larger.
        let length = SAMPLE + 6.0 + 7.6 * name.chars().count() as f64 + 12.0;
        if x > left && x + length > left + width {
            (x, y) = (left, y + ROW);
        }
        let middle = y + ROW / 2.0;
        let across = |svg: &mut Svg, class: &str| svg.line(class, [x, middle], [x + SAMPLE, middle]);
        let centre = [[x + SAMPLE / 2.0, middle]];
        match *key {
            Key::Line(class) => across(svg, class),
            Key::Points(shape, class) => svg.points(class, shape, 3.5, centre),
            Key::Both(line, shape, class) => {
                across(svg, line);
                svg.points(class, shape, 3.5, centre);
            }
            Key::Area(class) => svg.rect(class, [x, y + 3.0], [SAMPLE, ROW - 6.0]),
        }
        svg.text("name", [x + SAMPLE + 6.0, middle + 4.0], name);
        x += length;
    }
    y + ROW + 8.0
}
