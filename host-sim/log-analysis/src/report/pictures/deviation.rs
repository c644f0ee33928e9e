//! Errors by heading: before and after on one scale, and after enlarged with the expected error.

use super::super::frame::{ChartAxis, PlotFrame, closed_heading_curve};
use super::super::model::{CompassReport, DeviationCurve, magnitude_quantile, max_magnitude, subsample};
use super::super::svg::{MarkerShape, PicturePoint, Svg};
use crate::numbers::format_number;
use crate::report::pictures::picture::{LegendSample, Picture, draw_legend};

const PICTURE_SIZE: PicturePoint = [440.0, 350.0];

/// Largest number of points drawn.
const MAX_POINTS: usize = 700;

/// Fraction of the points that must lie within the frame of the deviation plot.
const FRAMED_FRACTION: f64 = 0.98;

/// CSS class of the line, marker, and CSS class of the points of the curves before the calibration.
const UNCALIBRATED_LINE_STYLES: [(&str, MarkerShape, &str); 3] =
    [("l l0", MarkerShape::Circle, "p0"), ("l l1", MarkerShape::Triangle, "p1"), ("l l2", MarkerShape::Square, "p2")];

pub fn common_scale_picture(compass_report: &CompassReport, difference_name: &str) -> Picture {
    let mut svg = Svg::new(PICTURE_SIZE[0], PICTURE_SIZE[1]);
    draw_before_and_after(&mut svg, [0.0, 0.0], compass_report, difference_name);
    let [before, after] =
        [&compass_report.curves_before, &compass_report.curves_after].map(|curves| max_error_deg(curves));
    let title = picture_title(compass_report).to_owned();
    let description = match (compass_report.curves_before.is_empty(), compass_report.curves_after.is_empty()) {
        (false, false) => {
            format!(
                "Largest {difference_name}: {} deg before, {} after.",
                format_number(before, 1),
                format_number(after, 1)
            )
        }
        (false, true) => format!("Largest {difference_name}: {} deg.", format_number(before, 1)),
        _ => "There is no reference heading.".to_owned(),
    };
    Picture { svg, title, caption: description.clone(), description, needs_full_width: false }
}

/// Draws the errors after calibration; none without data.
pub fn enlarged_picture(compass_report: &CompassReport, difference_name: &str) -> Option<Picture> {
    if compass_report.curves_after.is_empty() {
        return None;
    }
    let mut svg = Svg::new(PICTURE_SIZE[0], PICTURE_SIZE[1]);
    let points_outside = draw_enlarged(&mut svg, [0.0, 0.0], compass_report, difference_name);
    let mut descriptions = vec![format!(
        "The largest {difference_name} by heading is {} deg.",
        format_number(max_error_deg(&compass_report.curves_after), 2)
    )];
    if !compass_report.sigma_by_heading_deg.is_empty() {
        let sigma = max_magnitude(compass_report.sigma_by_heading_deg.iter().copied());
        descriptions.push(format!(
            "The band is {}, {} deg at the worst heading.",
            compass_report.sigma_description,
            format_number(sigma, 2)
        ));
    }
    if points_outside > 0 {
        descriptions.push(format!("{points_outside} of the points drawn would lie outside."));
    }
    let description = descriptions.join(" ");
    let title = "After, enlarged".to_owned();
    Some(Picture { svg, title, caption: description.clone(), description, needs_full_width: false })
}

/// Draws both frames side by side, for documents with one picture.
pub fn combined_picture(compass_report: &CompassReport, difference_name: &str) -> Picture {
    let mut svg = Svg::new(2.0 * PICTURE_SIZE[0], PICTURE_SIZE[1]);
    draw_before_and_after(&mut svg, [0.0, 0.0], compass_report, difference_name);
    let (common_scale, enlarged) =
        (common_scale_picture(compass_report, difference_name), enlarged_picture(compass_report, difference_name));
    if enlarged.is_some() {
        draw_enlarged(&mut svg, [PICTURE_SIZE[0], 0.0], compass_report, difference_name);
    }
    let description = enlarged.map_or_else(
        || common_scale.description.clone(),
        |enlarged| format!("{} {}", common_scale.description, enlarged.description),
    );
    Picture {
        svg,
        title: "Heading error before and after the calibration".to_owned(),
        caption: description.clone(),
        description,
        needs_full_width: true,
    }
}

fn picture_title(compass_report: &CompassReport) -> &'static str {
    if compass_report.curves_after.is_empty() { "Error by heading" } else { "Error by heading, before and after" }
}

fn max_error_deg(curves: &[DeviationCurve]) -> f64 {
    max_magnitude(curves.iter().flat_map(|curve| curve.errors_deg.iter().copied().flatten()))
}

fn plot_frame(plot_top: f64, [left, picture_top]: PicturePoint, error_axis: ChartAxis) -> PlotFrame {
    let upper_left = [left + 58.0, plot_top];
    PlotFrame {
        x: ChartAxis::for_headings(90),
        y: error_axis,
        upper_left,
        size: [PICTURE_SIZE[0] - 58.0 - 16.0, picture_top + PICTURE_SIZE[1] - 44.0 - plot_top],
    }
}

fn draw_title(svg: &mut Svg, [left, top]: PicturePoint, title: &str) -> PicturePoint {
    svg.draw_text("title", [left + 16.0, top + 20.0], title);
    [left + 16.0, top + 30.0]
}

fn draw_before_and_after(
    svg: &mut Svg,
    upper_left: PicturePoint,
    compass_report: &CompassReport,
    difference_name: &str,
) {
    let below = draw_title(svg, upper_left, picture_title(compass_report));
    let names: Vec<String> =
        compass_report.curves_before.iter().map(|curve| format!("before{}", name_suffix(&curve.curve_name))).collect();
    let mut legend_items: Vec<(LegendSample, &str)> = UNCALIBRATED_LINE_STYLES
        .iter()
        .zip(&names)
        .map(|(&(curve, shape, class), name)| (LegendSample::LineAndPoints(curve, shape, class), &**name))
        .collect();
    let after = match &compass_report.curves_after[..] {
        [only] => format!("after{}", name_suffix(&only.curve_name)),
        _ => "after, the same banks".to_owned(),
    };
    if !compass_report.curves_after.is_empty() {
        legend_items.push((LegendSample::Line("l l3"), &after));
    }
    let top = draw_legend(svg, below, PICTURE_SIZE[0] - 32.0, &legend_items);
    let y = ChartAxis::symmetric_deg(
        max_error_deg(&compass_report.curves_before).max(max_error_deg(&compass_report.curves_after)),
    );
    let frame = plot_frame(top, upper_left, y);
    frame.draw_axes(svg, "heading, deg", &format!("{difference_name}, deg"));
    for (curve, (class, shape, points)) in compass_report.curves_before.iter().zip(UNCALIBRATED_LINE_STYLES) {
        draw_curve(svg, &frame, curve, class, Some((shape, points)));
    }
    for curve in &compass_report.curves_after {
        draw_curve(svg, &frame, curve, "l l3", None);
    }
}

/// Returns the number of points outside the frame.
fn draw_enlarged(
    svg: &mut Svg,
    upper_left: PicturePoint,
    compass_report: &CompassReport,
    difference_name: &str,
) -> usize {
    let below = draw_title(svg, upper_left, "After, enlarged");
    let points: Vec<PicturePoint> = compass_report
        .samples
        .iter()
        .filter(|report_sample| report_sample.is_usable)
        .filter_map(|report_sample| {
            Some([
                report_sample.heading_deg?.rem_euclid(360.0),
                report_sample.error_parameters_deg.or(report_sample.error_deg)?,
            ])
        })
        .collect();
    let names: Vec<String> =
        compass_report.curves_after.iter().map(|curve| format!("after{}", name_suffix(&curve.curve_name))).collect();
    // A single line is drawn in the style of the combined picture.
    let classes = if compass_report.curves_after.len() > 1 {
        UNCALIBRATED_LINE_STYLES
    } else {
        [("l l3", MarkerShape::Circle, "p3"); 3]
    };
    let mut legend_items: Vec<(LegendSample, &str)> = classes
        .iter()
        .zip(&names)
        .map(|(&(curve, shape, class), name)| (LegendSample::LineAndPoints(curve, shape, class), &**name))
        .collect();
    if !compass_report.sigma_by_heading_deg.is_empty() {
        legend_items.push((LegendSample::Area("band"), "expected, 1 sigma"));
    }
    if !points.is_empty() {
        legend_items.push((LegendSample::Points(MarkerShape::Dot, "dot"), "single headings"));
    }
    let top = draw_legend(svg, below, PICTURE_SIZE[0] - 32.0, &legend_items);
    let limit_deg = max_error_deg(&compass_report.curves_after)
        .max(max_magnitude(compass_report.sigma_by_heading_deg.iter().copied()))
        .max(magnitude_quantile(points.iter().map(|[_, error]| *error), FRAMED_FRACTION));
    let frame = plot_frame(top, upper_left, ChartAxis::symmetric_deg(limit_deg));
    draw_expected_error_band(svg, &frame, &compass_report.sigma_by_heading_deg);
    frame.draw_axes(svg, "heading, deg", &format!("{difference_name}, deg"));
    let plotted: Vec<Option<PicturePoint>> =
        subsample(&points, MAX_POINTS).map(|&[x, y]| frame.plot_point(x, y)).collect();
    svg.draw_points("dot", MarkerShape::Dot, 1.4, plotted.iter().copied().flatten());
    for (curve, (class, shape, points)) in compass_report.curves_after.iter().zip(classes) {
        draw_curve(svg, &frame, curve, class, Some((shape, points)));
    }
    plotted.iter().filter(|point| point.is_none()).count()
}

fn draw_curve(
    svg: &mut Svg,
    frame: &PlotFrame,
    curve: &DeviationCurve,
    class: &str,
    points: Option<(MarkerShape, &str)>,
) {
    let positions: Vec<Option<PicturePoint>> = closed_heading_curve(&curve.errors_deg)
        .into_iter()
        .map(|point| point.and_then(|[x, y]| frame.plot_point(x, y)))
        .collect();
    svg.draw_path(class, positions.iter().copied());
    if let Some((shape, class)) = points {
        svg.draw_points(class, shape, 3.0, positions.into_iter().flatten());
    }
}

fn draw_expected_error_band(svg: &mut Svg, frame: &PlotFrame, sigma_deg: &[f64]) {
    let width_deg = 360.0 / sigma_deg.len().max(1) as f64;
    for (i, sigma) in sigma_deg.iter().enumerate().chain(sigma_deg.first().map(|first| (sigma_deg.len(), first))) {
        let heading_deg = i as f64 * width_deg;
        let [from, to] =
            [heading_deg - width_deg / 2.0, heading_deg + width_deg / 2.0].map(|deg| deg.clamp(0.0, 360.0));
        let [left, right] = [from, to].map(|deg| frame.x_position(deg));
        let [top, bottom] = [*sigma, -sigma].map(|deg| frame.y_position(deg));
        svg.draw_rectangle("band", [left, top], [right - left, bottom - top]);
    }
}

fn name_suffix(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(": {name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(errors_deg: &[f64]) -> DeviationCurve {
        let errors_deg = errors_deg.iter().map(|error| Some(*error)).collect();
        DeviationCurve { curve_name: "level".to_owned(), errors_deg, constant_deg: 0.0 }
    }

    #[test]
    fn the_enlarged_picture_has_its_own_scale() {
        let compass_report = CompassReport {
            curves_before: vec![curve(&[20.0, -18.0, 5.0, 1.0])],
            curves_after: vec![curve(&[0.4, -0.2, 0.1, 0.0])],
            sigma_by_heading_deg: vec![0.5; 4],
            sigma_description: "what is expected",
            ..CompassReport::default()
        };
        let common_scale = common_scale_picture(&compass_report, "error");
        let svg_text = common_scale.svg.to_inline("p", &common_scale.title, &common_scale.description);
        assert!(svg_text.contains(">20</text>") && svg_text.contains("20.0 deg before, 0.4 after"), "{svg_text}");
        let enlarged = enlarged_picture(&compass_report, "error").unwrap();
        let svg_text = enlarged.svg.to_inline("p", &enlarged.title, &enlarged.description);
        assert!(!svg_text.contains(">20</text>") && svg_text.contains(">0.4</text>"), "{svg_text}");
        assert_eq!(
            svg_text.matches(r#"class="band""#).count(),
            6,
            "four sectors, of which north has two halves, and the key"
        );
    }

    #[test]
    fn points_beyond_the_frame_are_counted() {
        let report_sample = |heading_deg: f64, error_deg: f64| super::super::super::model::ReportSample {
            heading_deg: Some(heading_deg),
            error_deg: Some(error_deg),
            is_usable: true,
            ..Default::default()
        };
        let mut report_samples: Vec<_> = (0..200).map(|i| report_sample(f64::from(i), 0.1)).collect();
        report_samples.push(report_sample(10.0, 50.0));
        let compass_report = CompassReport {
            curves_after: vec![curve(&[0.1, -0.1])],
            samples: report_samples,
            ..CompassReport::default()
        };
        assert!(enlarged_picture(&compass_report, "error").unwrap().description.contains("1 of the points drawn"));
    }
}
