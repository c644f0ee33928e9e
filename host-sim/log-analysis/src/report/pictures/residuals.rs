//! Residuals over time, with events.

use super::super::frame::{Axis, PlotFrame};
use super::super::model::{CompassReport, ReportSample, magnitude_quantile, max_magnitude};
use super::super::svg::{Point, Svg};
use super::{LegendSample, Picture, draw_legend};
use crate::numbers::format_number;

/// Largest number of columns, each drawn from its least to its largest value, which bounds the size of long flights.
const COLUMNS: usize = 500;

/// A line is interrupted at gaps longer than this time, seconds, and this number of columns.
const GAP_S: f64 = 3.0;
const GAP_COLUMNS: f64 = 4.0;

const LEFT: f64 = 62.0;
const WIDTH: f64 = 640.0;
const PANEL: f64 = 104.0;

type Panel<'a> = (&'a str, fn(&ReportSample) -> Option<f64>);

pub fn residuals_picture(compass_report: &CompassReport, word: &str) -> Option<Picture> {
    let error = format!("{word}, deg");
    let panels: Vec<Panel<'_>> = [
        ("strength, %", (|moment| moment.norm_residual_percent) as fn(&ReportSample) -> Option<f64>),
        ("inclination, deg", |moment| moment.inclination_residual_deg),
        (&error, |moment| moment.error_deg),
    ]
    .into_iter()
    .filter(|(_, quantity)| compass_report.samples.iter().any(|moment| quantity(moment).is_some_and(f64::is_finite)))
    .collect();
    let x = Axis::seconds(compass_report.samples.first()?.at_s, compass_report.samples.last()?.at_s);
    if panels.is_empty() {
        return None;
    }
    let rows = compass_report.marks.len().min(3) as f64;
    let mut svg = Svg::new(LEFT + WIDTH + 20.0, 76.0 + 15.0 * rows + (PANEL + 14.0) * panels.len() as f64);
    let items = [
        (LegendSample::Line("l trace"), "as it was"),
        (LegendSample::Line("edge"), "expected, 1 sigma"),
        (LegendSample::Area("bent"), "would not be sent"),
        (LegendSample::Area("off"), "not used"),
    ];
    let top = draw_legend(&mut svg, [16.0, 8.0], WIDTH + 60.0, &items) + 15.0 * rows;
    let mut beyond = 0;
    for (i, (name, quantity)) in panels.iter().enumerate() {
        let values = || compass_report.samples.iter().filter(|moment| moment.is_usable).filter_map(quantity);
        let most = (1.5 * magnitude_quantile(values(), 0.98))
            .min(max_magnitude(values()))
            .max(magnitude_quantile(values(), 0.5));
        beyond += values().filter(|value| value.abs() > 1.5 * most).count();
        let at = [LEFT, top + (PANEL + 14.0) * i as f64];
        let frame = PlotFrame { x, y: Axis::symmetric_deg(most), origin: at, size: [WIDTH, PANEL] };
        shade(&mut svg, &frame, &compass_report.samples);
        frame.draw(&mut svg, if i + 1 == panels.len() { "time, s" } else { "" }, name);
        svg.path("l trace", line(&frame, &compass_report.samples, quantity, false));
        if i + 1 == panels.len() && compass_report.samples.iter().any(|moment| moment.error_deg.is_some()) {
            for side in [1.0, -1.0] {
                let sigma =
                    |moment: &ReportSample| Some(side * moment.sigma_deg.filter(|_| moment.error_deg.is_some())?);
                svg.path("edge", line(&frame, &compass_report.samples, &sigma, true));
            }
        }
        for mark in &compass_report.marks {
            let across = frame.x_position(mark.at_s.clamp(x.range[0], x.range[1]));
            svg.line("moment", [across, at[1]], [across, frame.bottom()]);
        }
    }
    for (i, mark) in compass_report.marks.iter().take(3).enumerate() {
        let across = LEFT + WIDTH * ((mark.at_s - x.range[0]) / (x.range[1] - x.range[0])).clamp(0.0, 1.0);
        let class = if across > LEFT + WIDTH / 2.0 { "name end" } else { "name" };
        let y = top - 6.0 - 15.0 * (rows - 1.0 - i as f64);
        svg.text(class, [across, y], &mark.name);
        svg.line("moment", [across, y + 2.0], [across, top]);
    }
    Some(Picture { svg, title: "Over time".to_owned(), description: words(compass_report, beyond), is_wide: true })
}

fn words(compass_report: &CompassReport, beyond: usize) -> String {
    const WHAT: &str = "Strength and inclination of the corrected field, less the Earth's: with a correct calibration only \
                        noise about zero remains; a change of hard iron is a step, motor current or iron nearby a bump.";
    let mut words = vec![WHAT.to_owned()];
    for mark in &compass_report.marks {
        words.push(format!("{} s: {}.", format_number(mark.at_s, 0), mark.name));
    }
    let silent = compass_report.samples.iter().filter(|moment| moment.is_heading_withheld).count();
    if silent > 0 {
        let percent = 100.0 * silent as f64 / compass_report.samples.len().max(1) as f64;
        words.push(format!(
            "For {} % of the time the module would not have sent a heading.",
            format_number(percent, if percent < 1.0 { 2 } else { 1 })
        ));
    }
    if beyond > 0 {
        words.push(format!("{beyond} values beyond a frame are drawn on its edge."));
    }
    words.join(" ")
}

fn columns(moments: &[ReportSample]) -> usize {
    (moments.len() / 2).clamp(1, COLUMNS)
}

fn column(frame: &PlotFrame, columns: usize, at_s: f64) -> usize {
    let [from_s, to_s] = frame.x.range;
    (((at_s - from_s) / (to_s - from_s) * columns as f64) as usize).min(columns - 1)
}

/// Extremes or mean of each column as a line, interrupted at gaps.
fn line(
    frame: &PlotFrame,
    moments: &[ReportSample],
    quantity: &dyn Fn(&ReportSample) -> Option<f64>,
    is_mean: bool,
) -> Vec<Option<Point>> {
    let number = columns(moments);
    let mut each: Vec<Vec<[f64; 2]>> = vec![Vec::new(); number];
    for moment in moments {
        let Some(value) = quantity(moment).filter(|value| value.is_finite()) else { continue };
        if let Some(cell) = each.get_mut(column(frame, number, moment.at_s)) {
            cell.push([moment.at_s, value]);
        }
    }
    let gap_s = GAP_S.max(GAP_COLUMNS * (frame.x.range[1] - frame.x.range[0]) / number as f64);
    let mut points = Vec::new();
    let mut last_s = None;
    for cell in each {
        let Some(&[at_s, first]) = cell.last() else { continue };
        if last_s.is_some_and(|last_s| at_s - last_s > gap_s) {
            points.push(None);
        }
        last_s = Some(at_s);
        let x = frame.x_position(at_s);
        let values = || cell.iter().map(|[_, value]| *value);
        let [least, most] = [values().fold(first, f64::min), values().fold(first, f64::max)];
        if is_mean {
            points.push(Some([x, frame.y_position(values().sum::<f64>() / cell.len() as f64)]));
        } else {
            points.push(Some([x, frame.y_position(least)]));
            points.extend((most > least).then(|| Some([x, frame.y_position(most)])));
        }
    }
    points
}

/// Shades unusable times and times without a heading sent.
fn shade(svg: &mut Svg, frame: &PlotFrame, moments: &[ReportSample]) {
    let number = columns(moments);
    for (class, counts) in [("off", false), ("bent", true)] {
        let belongs = |moment: &ReportSample| moment.is_usable == counts && (moment.is_heading_withheld || !counts);
        let mut shaded = vec![false; number + 1];
        for moment in moments.iter().filter(|moment| belongs(moment)) {
            if let Some(cell) = shaded.get_mut(column(frame, number, moment.at_s)) {
                *cell = true;
            }
        }
        let mut from = None;
        for (i, is) in shaded.into_iter().enumerate() {
            match (is, from) {
                (true, None) => from = Some(i),
                (false, Some(first)) => {
                    let [left, right] =
                        [first, i].map(|column| frame.origin[0] + frame.size[0] * column as f64 / number as f64);
                    svg.rect(class, [left, frame.origin[1]], [right - left, frame.size[1]]);
                    from = None;
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::model::EventMark;
    use super::*;

    fn flight(number: u32, every_s: f64) -> CompassReport {
        let moment = |i: u32| ReportSample {
            at_s: f64::from(i) * every_s,
            norm_residual_percent: Some(f64::from(i % 7) - 3.0),
            is_usable: !(100..200).contains(&i),
            is_heading_withheld: (300..310).contains(&i),
            ..ReportSample::default()
        };
        let marks = vec![EventMark { at_s: 5.0, name: "iron changed".to_owned() }];
        CompassReport { samples: (0..number).map(moment).collect(), marks, ..CompassReport::default() }
    }

    #[test]
    fn an_hour_is_drawn_in_bounded_size_with_its_extremes() {
        let svg_text_of = |compass_report: &CompassReport| {
            residuals_picture(compass_report, "error").unwrap().svg.to_inline("p", "", "")
        };
        let mut hour = flight(180_000, 0.02);
        assert!(svg_text_of(&hour).len() < 30_000, "{}", svg_text_of(&hour).len());
        let before = svg_text_of(&hour);
        // Outliers do not set the scale but are visible on both sides.
        for (at, beyond) in [(90_000, -3.3), (120_000, 3.3)] {
            let drawn_before = svg_text_of(&hour);
            hour.samples[at].norm_residual_percent = Some(beyond);
            assert_ne!(drawn_before, svg_text_of(&hour), "{beyond}");
        }
        assert_eq!(before.matches(r#"class="off""#).count(), 2, "one span, and its key");
        assert_eq!(before.matches(r#"class="bent""#).count(), 2, "one span, and its key");
        assert!(before.contains(">iron changed</text>") && !before.contains("NaN"));
    }

    #[test]
    fn a_gap_breaks_the_line_and_no_samples_give_no_picture() {
        let mut compass_report = flight(400, 0.1);
        let frame = PlotFrame {
            x: Axis::seconds(0.0, 139.9),
            y: Axis::symmetric_deg(3.0),
            origin: [0.0; 2],
            size: [500.0, 100.0],
        };
        let gaps = |compass_report: &CompassReport| {
            line(&frame, &compass_report.samples, &|moment: &ReportSample| moment.norm_residual_percent, false)
                .iter()
                .filter(|at| at.is_none())
                .count()
        };
        assert_eq!(gaps(&compass_report), 0);
        for moment in &mut compass_report.samples[200..] {
            moment.at_s += 100.0;
        }
        assert_eq!(gaps(&compass_report), 1);
        assert!(residuals_picture(&CompassReport::default(), "error").is_none());
        let nothing = CompassReport { samples: vec![ReportSample::default(); 5], ..CompassReport::default() };
        assert!(residuals_picture(&nothing, "error").is_none());
    }
}
