//! `host-sim bench accuracy`.

use std::process::ExitCode;

use comfy_table::{Table, presets};
use host_sim::accuracy::flight::{Flight, Pattern};
use host_sim::accuracy::flights::{self, Row};
use host_sim::accuracy::{self, Coverage, Outcome, Plan};
use host_sim::world::aircraft::Kind;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::print::right_aligned;
use super::{Accuracy, Failure};

/// How long a flight is if nobody says.
const FLIGHT_MINUTES: f64 = 3.0;

/// Turns alone, or whole flights.
pub fn run(options: &Accuracy) -> Result<ExitCode, Failure> {
    let kind = Kind::from(options.aircraft);
    let plan = Plan { airframes: options.airframes, draws: options.draws, seed: options.seed };
    if kind == Kind::Plane && options.patterns.is_empty() && options.minutes.is_none() {
        turns(options, plan)
    } else {
        whole_flights(options, kind, plan)
    }
}

/// How far it is.
fn bar(airframes: u64) -> ProgressBar {
    let bar = ProgressBar::new(airframes);
    if let Ok(style) = ProgressStyle::with_template("airframes {bar:40} {pos}/{len} {eta}") {
        bar.set_style(style);
    }
    bar
}

fn turns(options: &Accuracy, plan: Plan) -> Result<ExitCode, Failure> {
    let bar = bar(plan.airframes);
    let outcome = accuracy::run(plan, &|| bar.inc(1));
    bar.finish_and_clear();
    if options.json {
        let mut value = serde_json::to_value(&outcome).map_err(|e| Failure(e.to_string()))?;
        value["airframes"] = json!(plan.airframes);
        value["draws"] = json!(plan.draws);
        value["seed"] = json!(plan.seed);
        println!("{value}");
    } else {
        show(plan, &outcome);
    }
    Ok(ExitCode::SUCCESS)
}

fn show(plan: Plan, outcome: &Outcome) {
    println!(
        "{} airframes, {} flights of each; bound {:.3} deg rms at the median",
        plan.airframes, plan.draws, outcome.bound_median_deg
    );
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(
        ["method", "rms/bound median", "worst decile", "rms median", "converged", "accepted", "wrong"]
            .map(right_aligned),
    );
    for method in &outcome.methods {
        table.add_row(
            [
                method.method.to_owned(),
                format!("{:.3}", method.ratio_median),
                format!("{:.3}", method.ratio_worst_decile),
                format!("{:.3} deg", method.rms_median_deg),
                format!("{:.1} %", method.converged_percent),
                format!("{:.1} %", method.accepted_percent),
                format!("{}", method.wrong),
            ]
            .map(right_aligned),
        );
    }
    println!("{table}");
    for (source, coverage) in
        [("noise alone", outcome.coverage), ("noise, bias and bank scale", outcome.coverage_with_faults)]
    {
        println!(
            "errors within 1 and 2 sigma, attitude with {source}: {:.1} % and {:.1} % of {} headings",
            coverage.one_sigma_percent, coverage.two_sigma_percent, coverage.headings
        );
    }
}

fn whole_flights(options: &Accuracy, kind: Kind, plan: Plan) -> Result<ExitCode, Failure> {
    let asked: Vec<Pattern> = options.patterns.iter().map(|&pattern| pattern.into()).collect();
    let patterns = if asked.is_empty() { Pattern::ALL.to_vec() } else { asked };
    let minutes = options.minutes.unwrap_or(FLIGHT_MINUTES);
    let bar = bar(plan.airframes * patterns.len() as u64);
    let rows: Vec<Row> = patterns
        .into_iter()
        .map(|pattern| flights::run(Flight { kind, pattern, minutes }, plan, &|| bar.inc(1)))
        .collect();
    bar.finish_and_clear();
    if options.json {
        let flights = serde_json::to_value(&rows).map_err(|e| Failure(e.to_string()))?;
        let Plan { airframes, draws, seed } = plan;
        println!("{}", json!({ "flights": flights, "airframes": airframes, "draws": draws, "seed": seed }));
    } else {
        show_flights(plan, &rows);
    }
    Ok(ExitCode::SUCCESS)
}

fn show_flights(plan: Plan, rows: &[Row]) {
    println!("{} airframes, {} draws of the noise of each", plan.airframes, plan.draws);
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(
        [
            "flight",
            "minutes",
            "readings",
            "rms median",
            "worst decile",
            "rms/kept median",
            "best bound",
            "rms/best median",
            "worst decile",
            "converged",
            "accepted",
            "wrong",
            "1/2 sigma",
            "with faults",
        ]
        .map(right_aligned),
    );
    let within = |coverage: Coverage| format!("{:.1}/{:.1} %", coverage.one_sigma_percent, coverage.two_sigma_percent);
    for row in rows {
        table.add_row(
            [
                format!("{} {}", row.aircraft, row.pattern.name()),
                format!("{:.0}", row.minutes),
                format!("{:.0}", row.readings),
                format!("{:.3} deg", row.rms_median_deg),
                format!("{:.3} deg", row.rms_worst_decile_deg),
                format!("{:.3}", row.kept_ratio_median),
                format!("{:.3} deg", row.best_bound_median_deg),
                format!("{:.3}", row.best_ratio_median),
                format!("{:.3}", row.best_ratio_worst_decile),
                format!("{:.1} %", row.converged_percent),
                format!("{:.1} %", row.accepted_percent),
                format!("{}", row.wrong),
                within(row.coverage),
                within(row.coverage_with_faults),
            ]
            .map(right_aligned),
        );
    }
    println!("{table}");
    println!("kept: the bound of the readings that were kept");
    println!("best: the bound of as many, the best of the flight, chosen afterwards (greedy, D-optimal)");
}
