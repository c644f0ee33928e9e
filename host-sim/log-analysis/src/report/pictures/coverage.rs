//! Picture of the headings and tilts flown.

use super::super::model::{CompassReport, ReportSample};
use super::super::svg::{MarkerShape, PicturePoint, Svg};
use crate::numbers::format_number;
use crate::report::pictures::picture::{LegendSample, Picture, draw_legend};

/// Number of heading sectors; sector `n` is centred on a heading of 30 `n` degrees.
const HEADING_SECTORS: usize = 12;

/// Row of the coverage picture: its name, and the test whether a sample belongs to it.
type TiltRow = (&'static str, fn(&ReportSample) -> bool);

const TILT_ROWS: [TiltRow; 8] = [
    ("30 and more right", |report_sample| report_sample.roll_deg >= 30.0),
    ("10 to 30 right", |report_sample| (10.0..30.0).contains(&report_sample.roll_deg)),
    ("wings level", |report_sample| report_sample.roll_deg.abs() < 10.0),
    ("10 to 30 left", |report_sample| report_sample.roll_deg <= -10.0 && report_sample.roll_deg > -30.0),
    ("30 and more left", |report_sample| report_sample.roll_deg <= -30.0),
    ("10 and more up", |report_sample| report_sample.pitch_deg >= 10.0),
    ("nose level", |report_sample| report_sample.pitch_deg.abs() < 10.0),
    ("10 and more down", |report_sample| report_sample.pitch_deg <= -10.0),
];

const BANK_ROW_COUNT: usize = 5;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct CoverageCell {
    flown_s: f64,
    fitted_count: usize,
}

impl CoverageCell {
    fn is_missing(self) -> bool {
        self.flown_s <= 0.0 && self.fitted_count == 0
    }
}

fn has_usable_field(report_sample: &ReportSample) -> bool {
    report_sample.is_usable && report_sample.raw_ut.is_some()
}

fn coverage_cells(compass_report: &CompassReport) -> [[CoverageCell; HEADING_SECTORS]; TILT_ROWS.len()] {
    let mut cells = [[CoverageCell::default(); HEADING_SECTORS]; TILT_ROWS.len()];
    // A sample represents the time until the next one, at most 1 s.
    let nexts = compass_report
        .samples
        .iter()
        .skip(1)
        .map(|next| next.time_s)
        .chain(compass_report.samples.last().map(|last| last.time_s));
    for (report_sample, next_s) in
        compass_report.samples.iter().zip(nexts).filter(|(report_sample, _)| has_usable_field(report_sample))
    {
        let Some(heading_deg) = report_sample.heading_deg.filter(|deg| deg.is_finite()) else { continue };
        let sector = (heading_deg / 30.0).round().rem_euclid(HEADING_SECTORS as f64) as usize;
        for (row, (_, belongs)) in cells.iter_mut().zip(TILT_ROWS) {
            if let Some(cell) = row.get_mut(sector).filter(|_| belongs(report_sample)) {
                cell.flown_s += (next_s - report_sample.time_s).clamp(0.0, 1.0);
                cell.fitted_count += usize::from(report_sample.is_fitted);
            }
        }
    }
    cells
}

pub fn coverage_picture(compass_report: &CompassReport) -> Picture {
    const LEFT_MARGIN: f64 = 142.0;
    const CELL_SIZE: PicturePoint = [40.0, 26.0];
    let cells = coverage_cells(compass_report);
    let mut svg = Svg::new(LEFT_MARGIN + CELL_SIZE[0] * HEADING_SECTORS as f64 + 16.0, 346.0);
    let knows = compass_report.has_fitted_marks;
    let number_is = if knows { "collected and fitted, number" } else { "flown, seconds" };
    let mut legend_items = vec![(LegendSample::Area("cell used"), number_is)];
    if knows {
        legend_items.push((LegendSample::Area("cell flown"), "flown, not collected"));
    }
    legend_items.push((LegendSample::Area("missed"), "not flown"));
    let top = draw_legend(&mut svg, [16.0, 8.0], 600.0, &legend_items) + 14.0;
    svg.draw_text("name", [16.0, top - 4.0], "bank, deg");
    for (row, ((name, _), cells)) in TILT_ROWS.iter().zip(&cells).enumerate() {
        let gap = if row < BANK_ROW_COUNT { 0.0 } else { 22.0 };
        let y = top + CELL_SIZE[1] * row as f64 + gap;
        if row == BANK_ROW_COUNT {
            svg.draw_text("name", [16.0, y - 4.0], "pitch, deg");
        }
        svg.draw_text("tick end", [LEFT_MARGIN - 6.0, y + 17.0], name);
        for (sector, cell) in cells.iter().enumerate() {
            draw_cell(&mut svg, [LEFT_MARGIN + CELL_SIZE[0] * sector as f64, y], CELL_SIZE, *cell, knows);
        }
    }
    let bottom = top + CELL_SIZE[1] * TILT_ROWS.len() as f64 + 22.0;
    for sector in 0..HEADING_SECTORS {
        svg.draw_text(
            "tick mid",
            [LEFT_MARGIN + CELL_SIZE[0] * (sector as f64 + 0.5), bottom + 16.0],
            &(30 * sector).to_string(),
        );
    }
    svg.draw_text(
        "name mid",
        [LEFT_MARGIN + CELL_SIZE[0] * HEADING_SECTORS as f64 / 2.0, bottom + 34.0],
        "heading, deg",
    );
    Picture {
        svg,
        title: "What was flown".to_owned(),
        description: coverage_in_words(&cells),
        caption: compass_report
            .advice
            .as_ref()
            .map_or_else(|| "Samples by heading and tilt.".to_owned(), |advice| format!("Most useful next: {advice}.")),
        needs_full_width: true,
    }
}

fn draw_cell(
    svg: &mut Svg,
    [x, y]: PicturePoint,
    [width, height]: PicturePoint,
    cell: CoverageCell,
    knows_fitted: bool,
) {
    if cell.is_missing() {
        svg.draw_rectangle("missed", [x + 2.0, y + 2.0], [width - 4.0, height - 4.0]);
        svg.draw_points("p2 faint", MarkerShape::Diamond, 2.0, [[x + width / 2.0, y + height / 2.0]]);
        return;
    }
    let is_used = !knows_fitted || cell.fitted_count > 0;
    svg.draw_rectangle(if is_used { "cell used" } else { "cell flown" }, [x, y], [width, height]);
    let count = if knows_fitted { cell.fitted_count as f64 } else { cell.flown_s.ceil() };
    if is_used {
        svg.draw_text("count mid", [x + width / 2.0, y + height / 2.0 + 4.0], &format_number(count, 0));
    }
}

fn coverage_in_words(cells: &[[CoverageCell; HEADING_SECTORS]; TILT_ROWS.len()]) -> String {
    let mut coverage_in_words = Vec::new();
    for ((name, _), row) in TILT_ROWS.iter().zip(cells) {
        let missing: Vec<String> = row
            .iter()
            .enumerate()
            .filter(|(_, cell)| cell.is_missing())
            .map(|(sector, _)| (30 * sector).to_string())
            .collect();
        coverage_in_words.push(match missing.len() {
            0 => format!("{name}: all headings flown"),
            HEADING_SECTORS => format!("{name}: none flown"),
            _ => format!("{name}: not flown {}", missing.join(", ")),
        });
    }
    format!("{}. Not every cell is required.", coverage_in_words.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flown_and_missing_headings_are_drawn_differently() {
        let report_sample = |at_s: f64, heading_deg: f64, roll_deg: f64, is_fitted: bool| ReportSample {
            time_s: at_s,
            heading_deg: Some(heading_deg),
            roll_deg,
            raw_ut: Some([20.0, 0.0, 40.0]),
            is_usable: true,
            is_fitted,
            ..ReportSample::default()
        };
        let report_samples = vec![
            report_sample(0.0, 350.0, 30.0, true),
            report_sample(0.5, 16.0, -12.0, false),
            report_sample(60.0, 16.0, 0.0, true),
        ];
        let compass_report =
            CompassReport { samples: report_samples, has_fitted_marks: true, ..CompassReport::default() };
        let cells = coverage_cells(&compass_report);
        // The first two samples are in different bank cells, the second for at most 1 s; the last has no duration but
        // is fitted.
        assert_eq!(cells[0][0], CoverageCell { flown_s: 0.5, fitted_count: 1 });
        assert_eq!(cells[3][1], CoverageCell { flown_s: 1.0, fitted_count: 0 });
        assert_eq!(cells[2][1], CoverageCell { flown_s: 0.0, fitted_count: 1 });
        assert_eq!(
            cells.as_flattened().iter().filter(|cell| **cell != CoverageCell::default()).count(),
            5,
            "three, and their pitch"
        );
        let picture = coverage_picture(&compass_report);
        let svg_text = picture.svg.to_inline("p", "", "");
        assert_eq!(svg_text.matches(r#"class="missed""#).count(), 8 * 12 - 5 + 1);
        assert!(
            picture.description.contains("10 and more up: none flown")
                && picture.description.contains("wings level: not flown 0, 60"),
            "{}",
            picture.description
        );
    }
}
