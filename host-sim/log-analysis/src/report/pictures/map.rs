//! Map of the flight.

use super::super::frame::{ChartAxis, PlotFrame};
use super::super::model::{CompassReport, ReportSample, subsample};
use super::super::svg::{MarkerShape, PicturePoint, Svg};
use crate::numbers::format_number;
use crate::report::pictures::picture::{LegendSample, Picture, draw_legend};

const MAX_TRACK_POINTS: usize = 2500;

/// Draws the map; none without positions.
pub fn map_picture(compass_report: &CompassReport) -> Option<Picture> {
    const MAP_SIDE: f64 = 400.0;
    let positions: Vec<PicturePoint> =
        compass_report.samples.iter().filter_map(|report_sample| report_sample.position_m).collect();
    let [east, north] = [0, 1].map(|axis| {
        let coordinates = positions.iter().map(move |position| position[axis]).filter(|number| number.is_finite());
        coordinates
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], number| [least.min(number), most.max(number)])
    });
    let is_known = east.iter().chain(&north).all(|end| end.is_finite());
    let map_width_m = (east[1] - east[0]).max(north[1] - north[0]).max(10.0);
    if !is_known {
        return None;
    }
    let (unit, per) = if map_width_m > 4000.0 { ("km", 1000.0) } else { ("m", 1.0) };
    // Equal scales on both axes.
    let axis = |[least, most]: [f64; 2]| {
        let centre = least.midpoint(most) / per;
        let half_width = 0.54 * map_width_m / per;
        ChartAxis {
            value_range: [centre - half_width, centre + half_width],
            grid_step: ChartAxis::for_range(0.0, 2.0 * half_width, 6.0).grid_step,
            lines_per_number: 1,
        }
    };
    let mut svg = Svg::new(MAP_SIDE + 90.0, MAP_SIDE + 110.0);
    let track_classes = track_classes(compass_report.has_fitted_marks);
    let mut legend_items: Vec<(LegendSample, &str)> =
        track_classes.iter().map(|track_class| (LegendSample::Line(track_class.css_class), track_class.name)).collect();
    if compass_report.has_fitted_marks {
        legend_items.push((LegendSample::Points(MarkerShape::Circle, "p2"), "collected"));
    }
    legend_items.extend([
        (LegendSample::Points(MarkerShape::Triangle, "p0"), "begins"),
        (LegendSample::Points(MarkerShape::Square, "p0"), "ends"),
    ]);
    let top = draw_legend(&mut svg, [16.0, 8.0], MAP_SIDE + 58.0, &legend_items);
    let frame = PlotFrame { x: axis(east), y: axis(north), upper_left: [70.0, top], size: [MAP_SIDE, MAP_SIDE] };
    frame.draw_axes(&mut svg, &format!("east, {unit}"), &format!("north, {unit}"));
    let point = |[x, y]: PicturePoint| frame.plot_point(x / per, y / per);
    for track_class in &track_classes {
        let track = subsample(&compass_report.samples, MAX_TRACK_POINTS).map(|report_sample| {
            report_sample.position_m.filter(|_| (track_class.belongs)(report_sample)).and_then(point)
        });
        svg.draw_path(track_class.css_class, track);
    }
    let collected = compass_report
        .samples
        .iter()
        .filter(|report_sample| report_sample.is_fitted)
        .filter_map(|report_sample| point(report_sample.position_m?));
    svg.draw_points("p2", MarkerShape::Circle, 2.2, collected);
    svg.draw_points("p0", MarkerShape::Triangle, 5.0, positions.first().and_then(|position| point(*position)));
    svg.draw_points("p0", MarkerShape::Square, 4.0, positions.last().and_then(|position| point(*position)));
    let decimals = usize::from(per > 1.0);
    let [wide, high] = [east, north].map(|[from, to]| format_number((to - from) / per, decimals));
    let fitted = compass_report.samples.iter().filter(|report_sample| report_sample.is_fitted).count();
    let collected = if compass_report.has_fitted_marks {
        format!(" {fitted} readings were collected and fitted to.")
    } else {
        String::new()
    };
    let description = format!("North is up. The flight spans {wide} by {high} {unit}.{collected}");
    Some(Picture {
        svg,
        title: "Where it was flown".to_owned(),
        caption: description.clone(),
        description,
        needs_full_width: false,
    })
}

struct TrackClass {
    name: &'static str,
    css_class: &'static str,
    belongs: fn(&ReportSample) -> bool,
}

/// Classes of the track: usability in a log, collection in a mission.
fn track_classes(knows_fitted: bool) -> [TrackClass; 2] {
    let track_class = |name, css_class, belongs| TrackClass { name, css_class, belongs };
    if knows_fitted {
        [
            track_class("not used", "l l0 thin faint", |report_sample| !report_sample.is_usable),
            track_class("used", "trace", |report_sample| report_sample.is_usable),
        ]
    } else {
        [
            track_class("while it collected", "trace", |report_sample| report_sample.raw_ut.is_some()),
            track_class("afterwards", "l l2 thin", |report_sample| report_sample.raw_ut.is_none()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_has_one_scale_and_needs_positions() {
        assert!(map_picture(&CompassReport::default()).is_none());
        let sample_at = |east: f64, north: f64| ReportSample {
            position_m: Some([east, north]),
            is_usable: true,
            ..ReportSample::default()
        };
        let report_samples = vec![sample_at(0.0, 0.0), sample_at(9000.0, 0.0), sample_at(9000.0, 3000.0)];
        let compass_report =
            CompassReport { samples: report_samples, has_fitted_marks: true, ..CompassReport::default() };
        let picture = map_picture(&compass_report).unwrap();
        assert!(picture.description.contains("9.0 by 3.0 km"), "{}", picture.description);
        let svg_text = picture.svg.to_inline("p", "", "");
        assert!(svg_text.contains("east, km") && !svg_text.contains("NaN"));
        let track = svg_text.split("class=\"trace\" d=\"M").nth(1).unwrap().split('"').next().unwrap();
        let numbers: Vec<f64> = track.split(['L', ' ']).map(|number| number.parse().unwrap()).collect();
        assert!(((numbers[2] - numbers[0]) - 3.0 * (numbers[3] - numbers[5])).abs() < 0.3, "{numbers:?}");
        // A map needs one position only; positions that are NaN are ignored.
        assert!(
            map_picture(&CompassReport { samples: vec![sample_at(5.0, 5.0)], ..CompassReport::default() }).is_some()
        );
        assert!(
            map_picture(&CompassReport { samples: vec![sample_at(f64::NAN, 5.0)], ..CompassReport::default() })
                .is_none()
        );
    }
}
