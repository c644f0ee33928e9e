//! The horizontal field, levelled: iron makes ellipses off the centre of the Earth's one circle.

use super::super::frame::{Axis, Frame};
use super::super::model::{Swung, most_of, thinned};
use super::super::svg::{At, Shape, Svg};
use super::super::text::number;
use super::{Key, Picture, legend};

/// So many points of each panel.
const POINTS: usize = 700;

/// Banked right, left, or neither.
fn side_of(roll_deg: f64) -> i8 {
    i8::from(roll_deg >= 10.0) - i8::from(roll_deg <= -10.0)
}

/// Before and after, side by side on one scale; none of nothing.
pub fn field(swung: &Swung) -> Option<Picture> {
    const SIDE: f64 = 250.0;
    let counted: Vec<_> = swung.moments.iter().filter(|moment| moment.is_usable).collect();
    let parts = |which: usize| counted.iter().filter_map(move |moment| moment.level_ut[which]).flatten();
    let most = most_of(parts(0), 0.999).max(most_of(parts(1), 0.999)).max(swung.horizontal_ut.unwrap_or(0.0));
    if most <= 0.0 {
        return None;
    }
    let axis = Axis { numbered: 1, ..Axis::deviations(0.0) };
    let half = 1.08 * most;
    let axis = Axis { ends: [-half, half], step: Axis::around(0.0, 2.0 * half, 6.0).step, ..axis };
    let mut svg = Svg::new(2.0 * (SIDE + 76.0), SIDE + 108.0);
    let items = [
        (Key::Points(Shape::Triangle, "p1"), "banked right"),
        (Key::Points(Shape::Square, "p2"), "banked left"),
        (Key::Points(Shape::Circle, "p0"), "level"),
        (Key::Line("l l3"), "Earth's field by the calibration"),
    ];
    let top = legend(&mut svg, [16.0, 8.0], 2.0 * SIDE + 120.0, &items) + 18.0;
    for (which, title) in ["before", "after"].into_iter().enumerate() {
        let left = 62.0 + which as f64 * (SIDE + 72.0);
        let frame = Frame { x: axis, y: axis, at: [left, top], size: [SIDE, SIDE] };
        svg.text("title", [left, top - 8.0], title);
        frame.draw(&mut svg, "to the left, uT", if which == 0 { "ahead, uT" } else { "" });
        let sides = [("p1", Shape::Triangle, 1_i8), ("p2", Shape::Square, -1), ("p0", Shape::Circle, 0)];
        for (class, shape, side) in sides {
            let points = thinned(&counted, POINTS)
                .filter(|moment| side_of(moment.roll_deg) == side)
                .filter_map(|moment| frame.point(moment.level_ut[which]?[1], moment.level_ut[which]?[0]));
            svg.points(class, shape, 1.7, points);
        }
        if let Some(radius_ut) = swung.horizontal_ut.filter(|_| which == 1) {
            let circle = (0..=90).map(|i| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 90.0).sin_cos();
                frame.point(radius_ut * sin, radius_ut * cos)
            });
            svg.path("l l3", circle.collect::<Vec<Option<At>>>());
        }
    }
    let radius = swung.horizontal_ut.map_or_else(String::new, |ut| format!(" Its radius is {} uT.", number(ut, 1)));
    let words = format!(
        "What a compass sees while the aircraft turns, pitch and bank taken out: iron makes ellipses off the centre, the \
         Earth's field alone one circle about it.{radius}"
    );
    Some(Picture { svg, title: "Horizontal field, before and after".to_owned(), words, is_wide: true })
}
