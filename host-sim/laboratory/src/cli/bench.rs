//! `lab bench speed` and `lab bench budget`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use crate::emulator::{self, Emulator, EmulatorError};
use crate::studies::accuracy::random_flight::{ConstantErrorSigmas, RandomFlight, RandomRanges};
use autoswing::calibration::{Method, Prior, Samples, solve_samples};
use clap::Args;
use log_analysis::numbers::median;
use serde_json::json;
use simulator::mission;
use simulator::world::WorldConfig;

use host_sim::command_failure::CommandFailure;
use host_sim::print::{self, right_aligned, show_spinner, wrapped_table};
use host_sim::termination::{SecondSignal, TerminationSignals};

/// Instruction counts on a Cortex-M4 against their limits, measured in QEMU.
///
/// Needs qemu-system-arm and the bench image from scripts/build-firmware. Exit code 1 if a limit is exceeded.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab bench budget --json")]
pub struct BudgetOptions {
    /// Bench image [default: target/firmware/mps2-an386-bench.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Solve time of each method, and simulated seconds a second, on this machine
#[derive(Debug, Args)]
#[command(after_help = "Example: lab bench speed")]
pub struct SpeedOptions {
    /// Print one JSON object instead of the text
    #[arg(long)]
    json: bool,
}

pub fn run_instruction_budget(options: &BudgetOptions) -> Result<ExitCode, CommandFailure> {
    let image = options.image.clone().unwrap_or_else(emulator::default_bench_image);
    let failed = |error: EmulatorError| CommandFailure(format!("{}: {error}", error.stable_code()));
    let interruption = TerminationSignals::install_handlers(SecondSignal::IsIgnored)?;
    let bar = show_spinner("counting instructions, some two minutes");
    let budgets = Emulator::start_with(
        &image,
        WorldConfig::of_table1(1),
        Emulator::SENDING_AUTOPILOT,
        Arc::clone(interruption.stop_flag()),
    )
    .and_then(|mut emulator| emulator::instruction_budget::count_budgets(&mut emulator));
    bar.finish_and_clear();
    if let Some(code) = interruption.exit_code() {
        return Ok(code);
    }
    let budgets = budgets.map_err(failed)?;
    if options.json {
        print::print_json(json!({ "budgets": budgets }))?;
    } else {
        let mut table = wrapped_table(["instructions", "limit", "of"]);
        for budget in &budgets {
            let counted = budget.counted.map_or_else(|| "not counted".to_owned(), |counted| counted.to_string());
            table.add_row([right_aligned(counted), right_aligned(budget.limit.to_string()), budget.description.into()]);
        }
        print::print_line(table);
    }
    Ok(if budgets.iter().all(emulator::instruction_budget::InstructionBudget::is_within_limit) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Measures wall-clock time, so the result is not reproducible from a seed.
pub fn run_speed(options: &SpeedOptions) -> Result<ExitCode, CommandFailure> {
    const TIMED_SOLVES: usize = 21;
    let trial = RandomFlight::draw_flight(&RandomRanges { samples_per_side: 256, ..RandomRanges::WORST_CASE }, 1);
    let (recording, _) = trial.record_flight(0, ConstantErrorSigmas::NO_ERRORS);
    let methods = [Method::MaximumLikelihood, Method::TwoPlane, Method::FourEllipse].map(|method| {
        (method.method_name(), median((0..TIMED_SOLVES).map(|_| solve_time_ms(method, recording.fit_samples()))))
    });
    let start = Instant::now();
    let mission_result = mission::fly_mission(WorldConfig::of_table1(1), mission::TurnPlan::default(), &mut |_| {});
    let simulated_per_real = mission_result.duration_s / start.elapsed().as_secs_f64();
    if options.json {
        let solve_ms: serde_json::Map<_, _> =
            methods.iter().map(|(name, solve_time_ms)| ((*name).to_owned(), json!(solve_time_ms))).collect();
        print::print_json(json!({ "solve_ms": solve_ms, "simulated_seconds_per_second": simulated_per_real.round() }))?;
    } else {
        for (name, solve_time_ms) in methods {
            print::print_line(format_args!(
                "{name}: {solve_time_ms:.2} ms for 2 x 256 samples, median of {TIMED_SOLVES}"
            ));
        }
        print::print_line(format_args!("{simulated_per_real:.0} simulated seconds a second"));
    }
    Ok(ExitCode::SUCCESS)
}

fn solve_time_ms(method: Method, samples: Samples<'_>) -> f64 {
    let start = Instant::now();
    // Only the time matters; closed-form methods may reject a wandering flight.
    let _ = std::hint::black_box(solve_samples(method, samples, &Prior::default()));
    start.elapsed().as_secs_f64() * 1e3
}
