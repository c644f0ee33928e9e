//! Picture of the levelled horizontal field: the Earth's is a centred circle; hard and soft iron make shifted ellipses.

use super::super::frame::{Axis, PlotFrame};
use super::super::model::{CompassReport, magnitude_quantile, subsample};
use super::super::svg::{Point, Shape, Svg};
use super::{LegendSample, Picture, draw_legend};
use crate::numbers::format_number;

/// Largest number of points in a panel.
const POINTS: usize = 700;

/// 1 if banked right, -1 left, 0 level.
fn bank_side(roll_deg: f64) -> i8 {
    i8::from(roll_deg >= 10.0) - i8::from(roll_deg <= -10.0)
}

/// Draws before and after on one scale; none without data.
pub fn field_picture(compass_report: &CompassReport) -> Option<Picture> {
    const SIDE: f64 = 250.0;
    let counted: Vec<_> = compass_report.samples.iter().filter(|moment| moment.is_usable).collect();
    let parts = |panel: usize| counted.iter().filter_map(move |moment| moment.level_ut[panel]).flatten();
    let most = magnitude_quantile(parts(0), 0.999)
        .max(magnitude_quantile(parts(1), 0.999))
        .max(compass_report.horizontal_ut.unwrap_or(0.0));
    if most <= 0.0 {
        return None;
    }
    let axis = Axis { number_every: 1, ..Axis::symmetric_deg(0.0) };
    let half = 1.08 * most;
    let axis = Axis { range: [-half, half], step: Axis::for_range(0.0, 2.0 * half, 6.0).step, ..axis };
    let mut svg = Svg::new(2.0 * (SIDE + 76.0), SIDE + 108.0);
    let items = [
        (LegendSample::Points(Shape::Triangle, "p1"), "banked right"),
        (LegendSample::Points(Shape::Square, "p2"), "banked left"),
        (LegendSample::Points(Shape::Circle, "p0"), "level"),
        (LegendSample::Line("l l3"), "Earth's field by the calibration"),
    ];
    let top = draw_legend(&mut svg, [16.0, 8.0], 2.0 * SIDE + 120.0, &items) + 18.0;
    for (panel, title) in ["before", "after"].into_iter().enumerate() {
        let left = 62.0 + panel as f64 * (SIDE + 72.0);
        let frame = PlotFrame { x: axis, y: axis, origin: [left, top], size: [SIDE, SIDE] };
        svg.text("title", [left, top - 8.0], title);
        frame.draw(&mut svg, "to the left, uT", if panel == 0 { "ahead, uT" } else { "" });
        let sides = [("p1", Shape::Triangle, 1_i8), ("p2", Shape::Square, -1), ("p0", Shape::Circle, 0)];
        for (class, shape, side) in sides {
            let points = subsample(&counted, POINTS)
                .filter(|moment| bank_side(moment.roll_deg) == side)
                .filter_map(|moment| frame.point(moment.level_ut[panel]?[1], moment.level_ut[panel]?[0]));
            svg.points(class, shape, 1.7, points);
        }
        if let Some(radius_ut) = compass_report.horizontal_ut.filter(|_| panel == 1) {
            let circle = (0..=90).map(|i| {
                let (sin, cos) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 90.0);
                frame.point(radius_ut * sin, radius_ut * cos)
            });
            svg.path("l l3", circle.collect::<Vec<Option<Point>>>());
        }
    }
    let radius = compass_report
        .horizontal_ut
        .map_or_else(String::new, |ut| format!(" Its radius is {} uT.", format_number(ut, 1)));
    let words = format!(
        "The field in level axes while the aircraft turns: with hard and soft iron an ellipse off the centre, without \
         them a circle about it.{radius}"
    );
    Some(Picture { svg, title: "Horizontal field, before and after".to_owned(), description: words, is_wide: true })
}
