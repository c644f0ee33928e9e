//! `lab bench accuracy`.

use std::fmt::Write as _;
use std::process::ExitCode;

use crate::studies::accuracy::flight::{FlightPattern, StudyFlight};
use crate::studies::accuracy::flight_study::{self, FlightStudyRow};
use crate::studies::accuracy::{self, AccuracyPlan, AccuracyResult, SigmaCoverage};
use clap::Args;
use serde_json::json;
use simulator::world::aircraft::VehicleKind;

use host_sim::command_failure::CommandFailure;
use host_sim::option_parsers::{integer_in_range, number_in_range, one_of};
use host_sim::print::{self, append_wrapped, progress_bar, table_of};
use log_analysis::numbers::json_name;

/// Random airframes: heading error of each method relative to the Cramer-Rao bound, and accuracy of sigma.
///
/// Soft iron to 30 %, hard iron to 3 times the horizontal field, mounting to 20 deg, inclination -70 to 75 deg, turns
/// at 15 to 45 deg of bank that wander by 2 deg, 192 samples a side, sensor noise 0.3 to 1 %, attitude noise 0.2 to 1
/// deg. Heading, roll and pitch of every sample are unknowns of the bound. 500 airframes take about two minutes.
///
/// For a copter or a VTOL, or with --pattern or --minutes, whole flights are flown at ten samples a second, from which
/// the module selects; attitude noise grows by 0.4 deg for each m/s^2 of acceleration. The bound is that of equally
/// many readings, the best of the flight, selected afterwards (greedy, D-optimal); errors are evaluated level and at 20
/// deg of tilt to eight sides, for an aeroplane level and at 30 deg of bank.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab bench accuracy --aircraft copter --airframes 5")]
pub struct AccuracyOptions {
    /// Kind of aircraft
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol", value_parser = one_of::<VehicleKind>("plane|copter|vtol"))]
    aircraft: VehicleKind,
    /// Flight patterns, one row each [default: all three; for an aeroplane turns only, all of them solved]
    #[arg(long = "pattern", value_name = "routine|mirrored|wandering", value_parser = one_of::<FlightPattern>("routine|mirrored|wandering"))]
    patterns: Vec<FlightPattern>,
    /// Duration of a flight, minutes, 1 to 120 [default: 3]
    #[arg(long, value_name = "MINUTES", value_parser = number_in_range(1.0, 120.0))]
    minutes: Option<f64>,
    /// Number of airframes, 1 to 1000000
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = integer_in_range(1_u64, 1_000_000))]
    airframes: u64,
    /// Draws of the noise for each airframe, 1 to 100000
    #[arg(long, default_value_t = 60, value_name = "N", value_parser = integer_in_range(1_u64, 100_000))]
    draws: u64,
    /// Seed of the first airframe, incremented for the others, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer_in_range(0, u64::MAX))]
    seed: u64,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Default duration of a flight, minutes.
const DEFAULT_FLIGHT_MINUTES: f64 = 3.0;

pub fn run_accuracy(options: &AccuracyOptions) -> Result<ExitCode, CommandFailure> {
    let vehicle_kind = options.aircraft;
    let plan = AccuracyPlan { airframe_count: options.airframes, noise_draws: options.draws, seed: options.seed };
    if vehicle_kind == VehicleKind::Plane && options.patterns.is_empty() && options.minutes.is_none() {
        run_turns_study(options, plan)
    } else {
        run_whole_flights_study(options, vehicle_kind, plan)
    }
}

fn run_turns_study(options: &AccuracyOptions, plan: AccuracyPlan) -> Result<ExitCode, CommandFailure> {
    let bar = progress_bar("airframes", plan.airframe_count);
    let outcome = accuracy::run_accuracy_study(plan, &|| bar.inc(1));
    bar.finish_and_clear();
    if options.json {
        let mut value = serde_json::to_value(&outcome).map_err(|error| CommandFailure(error.to_string()))?;
        value["airframes"] = json!(plan.airframe_count);
        value["draws"] = json!(plan.noise_draws);
        value["seed"] = json!(plan.seed);
        print::print_json(value)?;
    } else {
        print::print_text(&format_outcome(plan, &outcome));
    }
    Ok(ExitCode::SUCCESS)
}

fn format_outcome(plan: AccuracyPlan, outcome: &AccuracyResult) -> String {
    let AccuracyPlan { airframe_count: airframes, noise_draws: draws, .. } = plan;
    let mut text = String::new();
    let bound_deg = outcome.bound_median_deg;
    append_wrapped(
        &mut text,
        "",
        &format!("{airframes} airframes, {draws} flights of each; bound {bound_deg:.3} deg rms, median"),
    );
    let table = table_of(
        &outcome.methods,
        &[
            ("method", |method| method.method.to_owned()),
            ("rms/\nbound", |method| format!("{:.3}", method.ratio_median)),
            ("worst\n10 %", |method| format!("{:.3}", method.ratio_worst_decile)),
            ("rms,\ndeg", |method| format!("{:.3}", method.solves.rms_median_deg)),
            ("solved,\n%", |method| format!("{:.1}", method.solves.converged_percent)),
            ("accepted,\n%", |method| format!("{:.1}", method.solves.accepted_percent)),
            ("wrong", |method| method.solves.wrong_calibrations.to_string()),
        ],
    );
    let _ = writeln!(text, "{table}\nrms/bound, rms: medians over the airframes; worst 10 %: what a tenth exceeds");
    for (source, coverage) in
        [("noise alone", outcome.coverage), ("noise, bias and bank scale", outcome.coverage_with_faults)]
    {
        let SigmaCoverage { one_sigma_percent: one, two_sigma_percent: two, headings, .. } = coverage;
        append_wrapped(
            &mut text,
            "",
            &format!(
                "errors within 1 and 2 sigma, attitude with {source}: {one:.1} % and {two:.1} % of {headings} headings"
            ),
        );
    }
    text
}

fn run_whole_flights_study(
    options: &AccuracyOptions,
    vehicle_kind: VehicleKind,
    plan: AccuracyPlan,
) -> Result<ExitCode, CommandFailure> {
    let patterns =
        if options.patterns.is_empty() { FlightPattern::ALL_PATTERNS.to_vec() } else { options.patterns.clone() };
    let minutes = options.minutes.unwrap_or(DEFAULT_FLIGHT_MINUTES);
    let bar = progress_bar("airframes", plan.airframe_count * patterns.len() as u64);
    let rows: Vec<FlightStudyRow> = patterns
        .into_iter()
        .map(|pattern| {
            flight_study::run_flight_study(
                StudyFlight { kind: vehicle_kind, flight_pattern: pattern, duration_minutes: minutes },
                plan,
                &|| bar.inc(1),
            )
        })
        .collect();
    bar.finish_and_clear();
    if options.json {
        let flights = serde_json::to_value(&rows).map_err(|error| CommandFailure(error.to_string()))?;
        let AccuracyPlan { airframe_count: airframes, noise_draws: draws, seed } = plan;
        print::print_json(json!({ "flights": flights, "airframes": airframes, "draws": draws, "seed": seed }))?;
    } else {
        print::print_text(&format_flights(plan, &rows));
    }
    Ok(ExitCode::SUCCESS)
}

fn format_flights(plan: AccuracyPlan, rows: &[FlightStudyRow]) -> String {
    let AccuracyPlan { airframe_count: airframes, noise_draws: draws, .. } = plan;
    let name = |row: &FlightStudyRow| format!("{} {}", row.aircraft, json_name(row.pattern));
    let errors = table_of(
        rows,
        &[
            ("flight", name),
            ("minutes", |row| format!("{:.0}", row.minutes)),
            ("readings", |row| format!("{:.0}", row.retained_samples_median)),
            ("rms", |row| format!("{:.3}", row.solves.rms_median_deg)),
            ("worst\n10 %", |row| format!("{:.3}", row.rms_worst_decile_deg)),
            ("solved,\n%", |row| format!("{:.1}", row.solves.converged_percent)),
            ("accepted,\n%", |row| format!("{:.1}", row.solves.accepted_percent)),
            ("wrong", |row| row.solves.wrong_calibrations.to_string()),
        ],
    );
    let ratios = table_of(
        rows,
        &[
            ("flight", name),
            ("rms/\nkept", |row| format!("{:.3}", row.solver_loss_median)),
            ("best", |row| format!("{:.3}", row.best_bound_median_deg)),
            ("rms/\nbest", |row| format!("{:.3}", row.error_to_best_bound_median)),
            ("worst\n10 %", |row| format!("{:.3}", row.error_to_best_bound_worst_decile)),
            ("1/2\nsigma, %", |row| within(row.coverage)),
            ("with\nfaults, %", |row| within(row.coverage_with_faults)),
        ],
    );
    format!(
        "{airframes} airframes, {draws} draws of the noise of each; degrees, medians over the airframes\n{errors}\n{ratios}\n\
         worst 10 %: what a tenth of the airframes exceeds\n\
         kept: the bound of the readings that were kept\n\
         best: the bound of as many, the best of the flight, chosen afterwards (greedy,\n  D-optimal)\n"
    )
}

fn within(coverage: SigmaCoverage) -> String {
    format!("{:.1}/{:.1}", coverage.one_sigma_percent, coverage.two_sigma_percent)
}
