//! `lab bench imu`.

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use crate::studies::imu::{self, TrialScore};
use clap::Args;
use log_analysis::numbers::format_optional;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde_json::json;

use host_sim::command_failure::CommandFailure;
use host_sim::print::{self, table_of};

/// Attitude and heading from recorded gyro, accelerometer and magnetometer, against optical truth.
///
/// A table has the columns t_s; p_dps, q_dps, r_dps; ax_mps2, ay_mps2, az_mps2 (at rest level -9.8 in z); mx_ut, my_ut,
/// mz_ut; roll_ref_deg, pitch_ref_deg, yaw_ref_deg (empty where unknown); moving (1 in the rows that count). Axes are
/// forward, right, down. The sensor rests in the first second. Errors are those of the BROAD benchmark, RMS, heading
/// and total less the circular mean of the heading's.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab bench imu trial.csv")]
pub struct ImuOptions {
    /// Tables, separated by commas
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

pub fn run_imu(options: &ImuOptions) -> Result<ExitCode, CommandFailure> {
    let scores: Vec<TrialScore> = options.files.par_iter().map(score_file).collect::<Result<_, _>>()?;
    let name = |file: &PathBuf| file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let trials: Vec<(String, TrialScore)> = options.files.iter().map(name).zip(scores).collect();
    let mean_inclination_deg = trials.iter().map(|(_, score)| score.inclination_deg).sum::<f64>() / trials.len() as f64;
    if options.json {
        let trials: Vec<_> = trials.iter().map(|(name, score)| json!({ "trial": name, "score": score })).collect();
        print::print_json(json!({ "trials": trials, "mean_inclination_deg": mean_inclination_deg }))?;
        return Ok(ExitCode::SUCCESS);
    }
    let table = table_of(
        &trials,
        &[
            ("trial", |(name, _)| name.chars().take(30).collect()),
            ("total,\ndeg", |(_, score)| format_optional(score.total_deg, 2)),
            ("heading,\ndeg", |(_, score)| format_optional(score.heading_deg, 2)),
            ("with\nheading, %", |(_, score)| format!("{:.0}", score.heading_percent)),
            ("1/2\nsigma, %", |(_, score)| format_shares(score.heading_within_percent)),
            ("inclination,\ndeg", |(_, score)| format!("{:.2}", score.inclination_deg)),
            ("1/2\nsigma, %", |(_, score)| format_shares(score.tilt_within_percent)),
        ],
    );
    print::print_line(table);
    print::print_line(format_args!("inclination: {mean_inclination_deg:.3} deg, mean of the trials"));
    Ok(ExitCode::SUCCESS)
}

fn format_shares([one, two]: [f64; 2]) -> String {
    format!("{one:.0}/{two:.0}")
}

fn score_file(file: &PathBuf) -> Result<TrialScore, CommandFailure> {
    let failed = |code, error: String| CommandFailure::with_code(code, format!("{}: {error}", file.display()));
    let text = fs::read_to_string(file).map_err(|error| failed("file-unreadable", error.to_string()))?;
    let rows = imu::read_trial(&text).map_err(|error| failed("no-trial", error))?;
    imu::score_trial(&rows).ok_or_else(|| failed("no-trial", "no row is scored".to_owned()))
}
