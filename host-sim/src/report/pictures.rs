//! The pictures.

use autoswing::calibration::{Calibration, Orientation};
use nalgebra::Vector2;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::mission::{Flown, Glimpse};
use crate::score::Errors;

impl Glimpse {
    /// The horizontal field in the level frame, microtesla: ahead and to the right.
    fn levelled(&self, calibration: &Calibration) -> Vector2<f32> {
        self.attitude.level(calibration.apply(self.field)).ut.xy()
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn std::error::Error + Send + Sync>>;

// Okabe and Ito's colours, told apart by the colour-blind too.
const LEVEL: RGBColor = RGBColor(0, 0, 0);
const RIGHT: RGBColor = RGBColor(0, 114, 178);
const LEFT: RGBColor = RGBColor(213, 94, 0);
const BAND: RGBColor = RGBColor(0, 158, 115);

const FONT: &str = "sans-serif";

/// Draws into an SVG of some size.
fn svg(
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    Ok(text)
}

/// The expected error of the calibration, if there is one.
fn expected_rms_deg(flown: &Flown) -> Option<f64> {
    flown.result.as_ref().ok().map(|shown| shown.expected_rms_deg)
}

/// What stands over the right-hand pictures.
fn after_title(flown: &Flown, calibrated: &str) -> String {
    if flown.result.is_ok() { calibrated.to_owned() } else { "after: refused, still uncalibrated".to_owned() }
}

/// Heading errors before and after, one above the other, each at its own scale.
pub fn errors(flown: &Flown) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    svg((900, 720), |area| {
        let (upper, lower) = area.split_vertically(360);
        errors_panel(&upper, &flown.before, "before", None)?;
        errors_panel(&lower, &flown.after, &after_title(flown, "after (other scale)"), expected_rms_deg(flown))
    })
}

/// Heading errors before and after, side by side: for a page that has room for one picture.
pub fn before_after(flown: &Flown) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    svg((1000, 340), |area| {
        let (left, right) = area.split_horizontally(500);
        let title = |when: &str, errors: &Errors| format!("{when}: at most {:.1} deg", errors.figures().max_deg);
        errors_panel(&left, &flown.before, &title("before", &flown.before), None)?;
        errors_panel(&right, &flown.after, &after_title(flown, &title("after", &flown.after)), expected_rms_deg(flown))
    })
}

fn errors_panel(area: &Area<'_>, errors: &Errors, title: &str, expected_rms_deg: Option<f64>) -> Drawn {
    let largest = errors.figures().max_deg.max(expected_rms_deg.unwrap_or(0.0));
    // Room above the curves for the legend.
    let range = -1.15 * largest.max(0.1)..1.9 * largest.max(0.1);
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..360.0, range)?;
    chart
        .configure_mesh()
        .x_labels(13)
        .y_labels(9)
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("true heading, deg")
        .y_desc("heading error, deg")
        .x_label_formatter(&|x| format!("{x:.0}"))
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .draw()?;
    if let Some(sigma) = expected_rms_deg {
        let band = Rectangle::new([(0.0, -sigma), (360.0, sigma)], BAND.mix(0.18).filled());
        chart
            .draw_series([band])?
            .label("expected, 1 sigma")
            .legend(|(x, y)| Rectangle::new([(x, y - 5), (x + 18, y + 5)], BAND.mix(0.3).filled()));
    }
    for ((name, colour), bank) in
        [("level", LEVEL), ("right 25 deg", RIGHT), ("left 25 deg", LEFT)].into_iter().zip(&errors.0)
    {
        // The circle is closed: 360 repeats 0.
        let points = bank.iter().chain(&bank[..1]).enumerate().map(|(step, error)| (30.0 * step as f64, *error));
        chart
            .draw_series(LineSeries::new(points.clone(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(points.map(|point| Circle::new(point, 3, colour.filled())))?;
    }
    legend(&mut chart)
}

/// The field in the turns, levelled by the true attitude, before and after.
pub fn ellipses(flown: &Flown) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    // As high as makes the axes equal.
    svg((900, 462), |area| {
        let (left, right) = area.split_horizontally(450);
        let uncalibrated = Calibration::uncalibrated(Orientation::NONE);
        let furthest = flown.glimpses.iter().map(|g| f64::from(g.levelled(&uncalibrated).amax())).fold(1.0, f64::max);
        // Room in the corners for the legend, and one scale for both.
        let bound = 1.35 * furthest;
        ellipse_panel(&left, &flown.glimpses, &uncalibrated, bound, ("before", None))?;
        match &flown.result {
            Ok(shown) => {
                let calibration = &shown.calibration;
                let radius_ut = f64::from(calibration.total_ut * calibration.inclination_rad.cos());
                ellipse_panel(&right, &flown.glimpses, calibration, bound, ("after", Some(radius_ut)))
            }
            Err(_) => ellipse_panel(&right, &flown.glimpses, &uncalibrated, bound, (&after_title(flown, ""), None)),
        }
    })
}

/// North up, east to the right, so that a heading reads clockwise from the top.
fn ellipse_panel(
    area: &Area<'_>,
    glimpses: &[Glimpse],
    calibration: &Calibration,
    bound: f64,
    (title, radius_ut): (&str, Option<f64>),
) -> Drawn {
    let point = |glimpse: &Glimpse| {
        let level = glimpse.levelled(calibration);
        (f64::from(-level.y), f64::from(level.x))
    };
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(60)
        .build_cartesian_2d(-bound..bound, -bound..bound)?;
    chart
        .configure_mesh()
        .x_labels(7)
        .y_labels(7)
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("to the left, uT")
        .y_desc("ahead, uT")
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .draw()?;
    if let Some(radius_ut) = radius_ut {
        let circle = (0..=120).map(|i| f64::from(i) * std::f64::consts::TAU / 120.0);
        chart
            .draw_series(LineSeries::new(
                circle.map(|a| (radius_ut * a.sin(), radius_ut * a.cos())),
                BAND.stroke_width(2),
            ))?
            .label("Earth's field")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BAND.stroke_width(2)));
    }
    for (name, colour, right) in [("right turns", RIGHT, true), ("left turns", LEFT, false)] {
        let points = glimpses.iter().filter(|g| (g.attitude.roll_rad > 0.0) == right).map(point);
        chart
            .draw_series(points.map(|at| Circle::new(at, 2, colour.mix(0.7).filled())))?
            .label(name)
            .legend(move |(x, y)| Circle::new((x + 9, y), 4, colour.filled()));
    }
    legend(&mut chart)
}

fn legend<'a>(
    chart: &mut ChartContext<
        'a,
        SVGBackend<'a>,
        Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
    >,
) -> Drawn {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.2))
        .label_font((FONT, 14))
        .draw()?;
    Ok(())
}
