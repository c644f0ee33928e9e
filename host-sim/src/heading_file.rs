//! Headings of a log's readings, as `replay --out` writes them.

use std::io::Write as _;
use std::path::Path;

use autoswing::heading::NoHeading;
use log_analysis::log::LoggedFlight;
use log_analysis::replay::evaluation::CompassEvaluation;

/// Farthest reading from the row that it is averaged to, seconds: readings within 0.1 s are averaged.
const MAX_READING_TO_ROW_S: f64 = 0.06;

/// Writes a line for each reading of the log at its own time stamp: the heading of the row that it is part of, the number
/// of readings averaged to that row, and whether the module would have sent the heading. After a refusal the status is
/// that of a module without a calibration.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_headings(path: &Path, flight: &LoggedFlight, compass: Option<&CompassEvaluation>) -> std::io::Result<()> {
    let mut output_file = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(output_file, "t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg,readings")?;
    let Some((compass, module)) = compass.and_then(|compass| Some((compass, compass.module_result.as_ref()?))) else {
        return output_file.flush();
    };
    let logged = flight.compasses.iter().find(|logged| logged.compass_number == compass.compass_number);
    let stamps_s: Vec<f64> =
        logged.map_or_else(Vec::new, |logged| logged.field.rows().iter().map(|row| row.t_s).collect());
    let headings = &module.headings;
    let nearest_row = |stamp_s: f64| {
        // Rows are at the time of the field, which is older than its time stamp.
        let at_s = stamp_s - compass.latency.used_s;
        let next = headings.partition_point(|row| row.t_s < at_s);
        let neighbours = [next.checked_sub(1), Some(next)].into_iter().flatten();
        let distance_s = |index: usize| headings.get(index).map_or(f64::INFINITY, |row| (row.t_s - at_s).abs());
        neighbours
            .min_by(|a, b| distance_s(*a).total_cmp(&distance_s(*b)))
            .filter(|index| distance_s(*index) < MAX_READING_TO_ROW_S)
    };
    let rows: Vec<Option<usize>> = stamps_s.iter().map(|stamp_s| nearest_row(*stamp_s)).collect();
    let mut readings = vec![0_u32; headings.len()];
    rows.iter().flatten().for_each(|index| readings[*index] += 1);
    let is_refused = module.outcome.acceptance.is_err();
    let missing_status = if is_refused { NoHeading::Uncalibrated.stable_code() } else { "left-out" };
    for (stamp_s, index) in stamps_s.iter().zip(rows) {
        let Some(index) = index else {
            writeln!(output_file, "{stamp_s:.6},,,{missing_status},,,0")?;
            continue;
        };
        let row = &headings[index];
        let status = if is_refused { Err(NoHeading::Uncalibrated) } else { row.status };
        let status = status.map_or_else(NoHeading::stable_code, |()| "ok");
        let smooth = row
            .smoothed_and_sigma_deg
            .map_or_else(|| ",".to_owned(), |[deg, sigma_deg]| format!("{deg:.2},{sigma_deg:.2}"));
        let reading_count = readings[index];
        writeln!(
            output_file,
            "{stamp_s:.6},{:.2},{:.2},{status},{smooth},{reading_count}",
            row.heading_deg, row.sigma_deg
        )?;
    }
    output_file.flush()
}
