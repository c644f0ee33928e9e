//! `host-sim bench speed` and `host-sim bench budget`.

use std::process::ExitCode;
use std::time::Instant;

use autoswing::calibration::{Method, Prior, Samples, solve};
use comfy_table::{Table, presets};
use host_sim::accuracy::trial::{Faults, Ranges, Trial};
use host_sim::emulator::{self, Emulator, EmulatorError};
use host_sim::mission;
use host_sim::world::WorldConfig;
use serde_json::json;

use super::print::{right_aligned, rounded};
use super::{Budget, Failure, Speed};

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
