//! `host-sim bench accuracy`.

use std::fmt::Write as _;
use std::process::ExitCode;

use host_sim::studies::accuracy::flight::{Flight, FlightPattern};
use host_sim::studies::accuracy::flight_study::{self, FlightStudyRow};
use host_sim::studies::accuracy::{self, AccuracyPlan, AccuracyResult, Coverage};
use serde_json::json;
use simulator::world::aircraft::VehicleKind;

use super::failure::Failure;
use super::print::{self, append_wrapped, narrow_table, right_aligned};
use super::{Accuracy, progress};

/// Default duration of a flight, minutes.
const FLIGHT_MINUTES: f64 = 3.0;

pub fn run(options: &Accuracy) -> Result<ExitCode, Failure> {
    let kind = options.aircraft;
    let plan = AccuracyPlan { airframes: options.airframes, draws: options.draws, seed: options.seed };
    if kind == VehicleKind::Plane && options.patterns.is_empty() && options.minutes.is_none() {
        turns(options, plan)
    } else {
        run_whole_flights(options, kind, plan)
    }
}

fn turns(options: &Accuracy, plan: AccuracyPlan) -> Result<ExitCode, Failure> {
    let bar = progress("airframes", plan.airframes);
    let outcome = accuracy::run(plan, &|| bar.inc(1));
    bar.finish_and_clear();
    if options.json {
        let mut value = serde_json::to_value(&outcome).map_err(|e| Failure(e.to_string()))?;
        value["airframes"] = json!(plan.airframes);
        value["draws"] = json!(plan.draws);
        value["seed"] = json!(plan.seed);
        print::print_json(value)?;
    } else {
        print::print_text(&format_outcome(plan, &outcome));
    }
    Ok(ExitCode::SUCCESS)
}

fn format_outcome(plan: AccuracyPlan, outcome: &AccuracyResult) -> String {
    let AccuracyPlan { airframes, draws, .. } = plan;
    let mut text = String::new();
    let bound_deg = outcome.bound_median_deg;
    append_wrapped(
        &mut text,
        "",
        &format!("{airframes} airframes, {draws} flights of each; bound {bound_deg:.3} deg rms, median"),
    );
    let mut table =
        narrow_table(["method", "rms/\nbound", "worst\n10 %", "rms,\ndeg", "solved,\n%", "accepted,\n%", "wrong"]);
    for method in &outcome.methods {
        table.add_row(
            [
                method.method.to_owned(),
                format!("{:.3}", method.ratio_median),
                format!("{:.3}", method.ratio_worst_decile),
                format!("{:.3}", method.rms_median_deg),
                format!("{:.1}", method.converged_percent),
                format!("{:.1}", method.accepted_percent),
                format!("{}", method.wrong),
            ]
            .map(right_aligned),
        );
    }
    let _ = writeln!(text, "{table}\nrms/bound, rms: medians over the airframes; worst 10 %: what a tenth exceeds");
    for (source, coverage) in
        [("noise alone", outcome.coverage), ("noise, bias and bank scale", outcome.coverage_with_faults)]
    {
        let Coverage { one_sigma_percent: one, two_sigma_percent: two, headings, .. } = coverage;
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

fn run_whole_flights(options: &Accuracy, kind: VehicleKind, plan: AccuracyPlan) -> Result<ExitCode, Failure> {
    let patterns = if options.patterns.is_empty() { FlightPattern::ALL.to_vec() } else { options.patterns.clone() };
    let minutes = options.minutes.unwrap_or(FLIGHT_MINUTES);
    let bar = progress("airframes", plan.airframes * patterns.len() as u64);
    let rows: Vec<FlightStudyRow> = patterns
        .into_iter()
        .map(|pattern| flight_study::run(Flight { kind, pattern, minutes }, plan, &|| bar.inc(1)))
        .collect();
    bar.finish_and_clear();
    if options.json {
        let flights = serde_json::to_value(&rows).map_err(|e| Failure(e.to_string()))?;
        let AccuracyPlan { airframes, draws, seed } = plan;
        print::print_json(json!({ "flights": flights, "airframes": airframes, "draws": draws, "seed": seed }))?;
    } else {
        print::print_text(&format_flights(plan, &rows));
    }
    Ok(ExitCode::SUCCESS)
}

fn format_flights(plan: AccuracyPlan, rows: &[FlightStudyRow]) -> String {
    let AccuracyPlan { airframes, draws, .. } = plan;
    let name = |row: &FlightStudyRow| format!("{} {}", row.aircraft, row.pattern.name());
    let mut errors =
        narrow_table(["flight", "minutes", "readings", "rms", "worst\n10 %", "solved,\n%", "accepted,\n%", "wrong"]);
    let mut ratios =
        narrow_table(["flight", "rms/\nkept", "best", "rms/\nbest", "worst\n10 %", "1/2\nsigma, %", "with\nfaults, %"]);
    for row in rows {
        let within = |sigma_coverage: Coverage| {
            format!("{:.1}/{:.1}", sigma_coverage.one_sigma_percent, sigma_coverage.two_sigma_percent)
        };
        errors.add_row(
            [
                name(row),
                format!("{:.0}", row.minutes),
                format!("{:.0}", row.readings),
                format!("{:.3}", row.rms_median_deg),
                format!("{:.3}", row.rms_worst_decile_deg),
                format!("{:.1}", row.converged_percent),
                format!("{:.1}", row.accepted_percent),
                format!("{}", row.wrong),
            ]
            .map(right_aligned),
        );
        ratios.add_row(
            [
                name(row),
                format!("{:.3}", row.kept_ratio_median),
                format!("{:.3}", row.best_bound_median_deg),
                format!("{:.3}", row.best_ratio_median),
                format!("{:.3}", row.best_ratio_worst_decile),
                within(row.coverage),
                within(row.coverage_with_faults),
            ]
            .map(right_aligned),
        );
    }
    format!(
        "{airframes} airframes, {draws} draws of the noise of each; degrees, medians over the airframes\n{errors}\n{ratios}\n\
         worst 10 %: what a tenth of the airframes exceeds\n\
         kept: the bound of the readings that were kept\n\
         best: the bound of as many, the best of the flight, chosen afterwards (greedy,\n  D-optimal)\n"
    )
}
