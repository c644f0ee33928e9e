//! Where it was flown.

use super::super::frame::{Axis, Frame};
use super::super::model::{Moment, Swung, thinned};
use super::super::svg::{At, Shape, Svg};
use super::super::text::number;
use super::{Key, Picture, legend};

/// So many points of the track are drawn.
const POINTS: usize = 2500;

/// The map; none where no positions are known.
pub fn map(swung: &Swung) -> Option<Picture> {
    const SIDE: f64 = 400.0;
    let places: Vec<At> = swung.moments.iter().filter_map(|moment| moment.place_m).collect();
    let [east, north] = [0, 1].map(|axis| {
        let all = places.iter().map(move |place| place[axis]).filter(|number| number.is_finite());
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], number| [least.min(number), most.max(number)])
    });
    let is_known = east.iter().chain(&north).all(|end| end.is_finite());
    let side = (east[1] - east[0]).max(north[1] - north[0]).max(10.0);
    if !is_known {
        return None;
    }
    let (unit, per) = if side > 4000.0 { ("km", 1000.0) } else { ("m", 1.0) };
    // Both axes are alike, so that a circle is one.
    let axis = |[least, most]: [f64; 2]| {
        let middle = least.midpoint(most) / per;
        let half = 0.54 * side / per;
        Axis { ends: [middle - half, middle + half], step: Axis::around(0.0, 2.0 * half, 6.0).step, numbered: 1 }
    };
    let mut svg = Svg::new(SIDE + 90.0, SIDE + 110.0);
    let kinds = kinds(swung.knows_fitted);
    let mut items: Vec<(Key, &str)> = kinds.iter().map(|kind| (Key::Line(kind.class), kind.name)).collect();
    if swung.knows_fitted {
        items.push((Key::Points(Shape::Circle, "p2"), "collected"));
    }
    items.extend([(Key::Points(Shape::Triangle, "p0"), "begins"), (Key::Points(Shape::Square, "p0"), "ends")]);
    let top = legend(&mut svg, [16.0, 8.0], SIDE + 58.0, &items);
    let frame = Frame { x: axis(east), y: axis(north), at: [70.0, top], size: [SIDE, SIDE] };
    frame.draw(&mut svg, &format!("east, {unit}"), &format!("north, {unit}"));
    let point = |[x, y]: At| frame.point(x / per, y / per);
    for kind in &kinds {
        let track = thinned(&swung.moments, POINTS)
            .map(|moment| moment.place_m.filter(|_| (kind.belongs)(moment)).and_then(point));
        svg.path(kind.class, track);
    }
    let collected = swung.moments.iter().filter(|moment| moment.is_fitted).filter_map(|moment| point(moment.place_m?));
    svg.points("p2", Shape::Circle, 2.2, collected);
    svg.points("p0", Shape::Triangle, 5.0, places.first().and_then(|place| point(*place)));
    svg.points("p0", Shape::Square, 4.0, places.last().and_then(|place| point(*place)));
    let decimals = usize::from(per > 1.0);
    let [wide, high] = [east, north].map(|[from, to]| number((to - from) / per, decimals));
    let fitted = swung.moments.iter().filter(|moment| moment.is_fitted).count();
    let collected =
        if swung.knows_fitted { format!(" {fitted} readings were collected and fitted to.") } else { String::new() };
    let words = format!("North is up. The flight spans {wide} by {high} {unit}.{collected}");
    Some(Picture { svg, title: "Where it was flown".to_owned(), words, is_wide: false })
}

/// A part of the track.
struct Kind {
    name: &'static str,
    class: &'static str,
    belongs: fn(&Moment) -> bool,
}

/// Of a log, what counts; of a mission, when it collected.
fn kinds(knows_fitted: bool) -> [Kind; 2] {
    let kind = |name, class, belongs| Kind { name, class, belongs };
    if knows_fitted {
        [
            kind("does not count", "l l0 thin faint", |moment| !moment.is_usable),
            kind("flown, counts", "trace", |moment| moment.is_usable),
        ]
    } else {
        [
            kind("while it collected", "trace", |moment| moment.level_ut[0].is_some()),
            kind("afterwards", "l l2 thin", |moment| moment.level_ut[0].is_none()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_has_one_scale_and_needs_places() {
        assert!(map(&Swung::default()).is_none());
        let at = |east: f64, north: f64| Moment { place_m: Some([east, north]), is_usable: true, ..Moment::default() };
        let moments = vec![at(0.0, 0.0), at(9000.0, 0.0), at(9000.0, 3000.0)];
        let swung = Swung { moments, knows_fitted: true, ..Swung::default() };
        let picture = map(&swung).unwrap();
        assert!(picture.words.contains("9.0 by 3.0 km"), "{}", picture.words);
        let drawn = picture.svg.inline("p", "", "");
        assert!(drawn.contains("east, km") && !drawn.contains("NaN"));
        // 9 km to the right are three times 3 km up.
        let track = drawn.split("class=\"trace\" d=\"M").nth(1).unwrap().split('"').next().unwrap();
        let numbers: Vec<f64> = track.split(['L', ' ']).map(|number| number.parse().unwrap()).collect();
        assert!(((numbers[2] - numbers[0]) - 3.0 * (numbers[3] - numbers[5])).abs() < 0.3, "{numbers:?}");
        // One place, or one that is no number, is no reason to fail.
        assert!(map(&Swung { moments: vec![at(5.0, 5.0)], ..Swung::default() }).is_some());
        assert!(map(&Swung { moments: vec![at(f64::NAN, 5.0)], ..Swung::default() }).is_none());
    }
}
