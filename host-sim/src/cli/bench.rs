//! `host-sim bench accuracy`, `host-sim bench speed` and `host-sim bench budget`.

use std::process::ExitCode;
use std::time::Instant;

use autoswing::calibration::{Method, Prior, Samples, solve};
use comfy_table::{Table, presets};
use host_sim::accuracy::trial::{Faults, Ranges, Trial};
use host_sim::accuracy::{self, Outcome, Plan};
use host_sim::emulator::{self, Emulator, EmulatorError};
use host_sim::mission;
use host_sim::world::WorldConfig;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::print::{right_aligned, rounded};
use super::{Accuracy, Budget, Failure, Speed};

pub fn accuracy(options: &Accuracy) -> Result<ExitCode, Failure> {
    let plan = Plan { airframes: options.airframes, draws: options.draws, seed: options.seed };
    let bar = ProgressBar::new(plan.airframes);
    if let Ok(style) = ProgressStyle::with_template("airframes {bar:40} {pos}/{len} {eta}") {
        bar.set_style(style);
    }
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

/// `host-sim bench budget`.
pub fn budget(options: &Budget) -> Result<ExitCode, Failure> {
    let image = options.image.clone().unwrap_or_else(emulator::default_bench_image);
    let failed = |error: EmulatorError| Failure(format!("{}: {error}", error.code()));
    let mut emulator = Emulator::start(&image, WorldConfig::table1(1)).map_err(failed)?;
    let budgets = emulator::budget::count(&mut emulator).map_err(failed)?;
    if options.json {
        println!("{}", json!({ "budgets": budgets }));
    } else {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(["instructions", "limit", "of"]);
        for budget in &budgets {
            let counted = budget.counted.map_or_else(|| "not counted".to_owned(), |counted| counted.to_string());
            table.add_row([right_aligned(counted), right_aligned(budget.limit.to_string()), budget.of.into()]);
        }
        println!("{table}");
    }
    Ok(if budgets.iter().all(emulator::budget::Budget::is_kept) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Wall clock: the one command that is not a function of its seed.
pub fn speed(options: &Speed) -> ExitCode {
    const RUNS: usize = 21;
    let trial = Trial::draw(&Ranges { samples: 256, ..Ranges::HARSH }, 1);
    let (recorded, _) = trial.record(0, Faults::NONE);
    let methods = [Method::MaximumLikelihood, Method::TwoPlane, Method::FourEllipse].map(|method| {
        let mut times_ms: Vec<f64> = (0..RUNS).map(|_| time_ms(method, recorded.samples())).collect();
        times_ms.sort_by(f64::total_cmp);
        (method.name(), times_ms[RUNS / 2])
    });
    let start = Instant::now();
    let flown = mission::fly(WorldConfig::table1(1), mission::Plan::default(), &mut |_, _| {});
    let simulated_per_real = flown.duration_s / start.elapsed().as_secs_f64();
    if options.json {
        let solve_ms: serde_json::Map<_, _> =
            methods.iter().map(|(name, ms)| ((*name).to_owned(), json!(rounded(*ms, 3)))).collect();
        println!("{}", json!({ "solve_ms": solve_ms, "simulated_seconds_per_second": rounded(simulated_per_real, 0) }));
    } else {
        for (name, ms) in methods {
            println!("{name}: {ms:.2} ms for 2 x 256 samples, median of {RUNS}");
        }
        println!("{simulated_per_real:.0} simulated seconds a second");
    }
    ExitCode::SUCCESS
}

fn time_ms(method: Method, samples: Samples<'_>) -> f64 {
    let start = Instant::now();
    // What counts is the time; closed forms may well refuse a flight that wanders.
    let _ = std::hint::black_box(solve(method, samples, &Prior::default()));
    start.elapsed().as_secs_f64() * 1e3
}
