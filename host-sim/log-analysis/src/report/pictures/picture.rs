//! A drawing with its texts, and its legend.

use super::super::svg::{MarkerShape, PicturePoint, Svg};

pub struct Picture {
    pub svg: Svg,
    pub title: String,
    /// Description for screen readers.
    pub description: String,
    /// Text below the picture.
    pub caption: String,
    /// Whether the picture needs the page's full width.
    pub needs_full_width: bool,
}

/// Symbol in a legend: line, points, both, or a filled area, with style classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegendSample {
    Line(&'static str),
    Points(MarkerShape, &'static str),
    LineAndPoints(&'static str, MarkerShape, &'static str),
    Area(&'static str),
}

const LEGEND_ROW_HEIGHT: f64 = 18.0;

/// Draws a legend in as many rows as needed; returns its lower edge.
pub fn draw_legend(svg: &mut Svg, [left, top]: PicturePoint, width: f64, legend_items: &[(LegendSample, &str)]) -> f64 {
    const LEGEND_SAMPLE_WIDTH: f64 = 24.0;
    let (mut x, mut y) = (left, top);
    for (key, name) in legend_items {
        // Upper bound of the mean letter width, also on narrow screens with larger letters.
        let length = LEGEND_SAMPLE_WIDTH + 6.0 + 7.6 * name.chars().count() as f64 + 12.0;
        if x > left && x + length > left + width {
            (x, y) = (left, y + LEGEND_ROW_HEIGHT);
        }
        let middle_y = y + LEGEND_ROW_HEIGHT / 2.0;
        let across =
            |svg: &mut Svg, class: &str| svg.draw_line(class, [x, middle_y], [x + LEGEND_SAMPLE_WIDTH, middle_y]);
        let centre = [[x + LEGEND_SAMPLE_WIDTH / 2.0, middle_y]];
        match *key {
            LegendSample::Line(class) => across(svg, class),
            LegendSample::Points(shape, class) => svg.draw_points(class, shape, 3.5, centre),
            LegendSample::LineAndPoints(line, shape, class) => {
                across(svg, line);
                svg.draw_points(class, shape, 3.5, centre);
            }
            LegendSample::Area(class) => {
                svg.draw_rectangle(class, [x, y + 3.0], [LEGEND_SAMPLE_WIDTH, LEGEND_ROW_HEIGHT - 6.0]);
            }
        }
        svg.draw_text("name", [x + LEGEND_SAMPLE_WIDTH + 6.0, middle_y + 4.0], name);
        x += length;
    }
    y + LEGEND_ROW_HEIGHT + 8.0
}
