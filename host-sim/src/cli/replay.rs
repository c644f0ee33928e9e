//! `host-sim replay`.

use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use autoswing::calibration::{Latency, Solution};
use autoswing::compass::Refusal;
use autoswing::heading::NoHeading;
use comfy_table::{Table, presets};
use host_sim::replay::recording::{self, Row};
use host_sim::replay::{self, Options, Refused, Replayed, Score, Shown};
use serde_json::{Value, json};

use super::print::{coefficients, right_aligned, rounded, shortest};
use super::{Failure, Replay};

pub fn run(options: &Replay) -> Result<ExitCode, Failure> {
    let name = options.file.display();
    let rows = recording::read(&options.file, options.unit.into()).map_err(|e| Failure(format!("{name}: {e}")))?;
    let replayed = replay::replay(
        &rows,
        &Options {
            selected: options.samples.into(),
            inclination_deg: options.inclination,
            fit_until_s: options.fit_until,
        },
    );
    if let Some(path) = &options.out {
        write(path, &replayed.shown).map_err(|e| Failure(format!("cannot write {}: {e}", path.display())))?;
    }
    if options.json {
        println!("{}", summary(&rows, &replayed));
    } else {
        show(&rows, &replayed);
    }
    Ok(if replayed.accepted.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The refusal as the module would tell it.
fn refusal(replayed: &Replayed) -> Option<Refusal> {
    let refusal = match replayed.accepted.as_ref().err()? {
        Refused::Solve(error) => Refusal::Solve(*error),
        Refused::Rejected(rejection) => Refusal::Rejected(*rejection),
    };
    Some(refusal.because(replayed.lack))
}

fn summary(rows: &[Row], replayed: &Replayed) -> Value {
    let solution = replayed.solution.as_ref();
    let rms = |score: &Option<Score>| score.map(|s| rounded(s.rms_deg, 3));
    json!({
        "accepted": replayed.accepted.is_ok(),
        "refusal": refusal(replayed).map(|r| json!({ "code": r.code(), "words": r.to_string() })),
        "method": solution.map(|s| s.quality.method.name()),
        "coefficients": solution.map(|s| coefficients(&s.calibration)),
        "inclination_deg": solution.map(|s| shortest(s.calibration.inclination_rad.to_degrees())),
        "expected_rms_deg": solution.map(|s| shortest(s.quality.expected_rms_deg)),
        "iron_changed_ut": solution.and_then(|s| s.iron).map(|doubt| shortest(doubt.of.ut)),
        "bank_read": solution.and_then(|s| s.bank).map(|doubt| shortest(doubt.of.read)),
        "latency_ms": solution.map(|s| rounded(f64::from(s.calibration.latency_s) * 1e3, 1)),
        "latency_found_ms": latency(solution).map(|l| rounded(f64::from(l.found_s) * 1e3, 1)),
        "latency_sigma_ms": latency(solution).map(|l| rounded(f64::from(l.sigma_s) * 1e3, 1)),
        "rows": rows.len(),
        "samples": replayed.samples,
        "ended_s": replayed.ended_s.map(|seconds| rounded(seconds, 1)),
        "heading_rms_deg": rms(&replayed.score),
        "heading_mean_deg": replayed.score.map(|s| rounded(s.mean_deg, 3)),
        "within_one_sigma_percent": replayed.score.map(|s| rounded(s.within_percent[0], 1)),
        "within_two_sigma_percent": replayed.score.map(|s| rounded(s.within_percent[1], 1)),
        "uncorrected_rms_deg": rms(&replayed.uncorrected),
        "smooth": replayed.smooth.map(|s| json!({
            "heading_rms_deg": rounded(s.rms_deg, 3),
            "heading_mean_deg": rounded(s.mean_deg, 3),
            "within_one_sigma_percent": rounded(s.within_percent[0], 1),
            "within_two_sigma_percent": rounded(s.within_percent[1], 1),
        })),
    })
}

/// What the samples showed of the attitude's latency.
fn latency(solution: Option<&Solution>) -> Option<Latency> {
    solution.and_then(|solution| solution.quality.latency)
}

fn show(rows: &[Row], replayed: &Replayed) {
    println!("{} rows, {} samples fitted to", rows.len(), replayed.samples);
    if let Some(ended_s) = replayed.ended_s {
        println!("the module would have had enough {ended_s:.0} s after the first row");
    }
    if let Some(refusal) = refusal(replayed) {
        println!("the module would refuse: {}: {refusal}", refusal.code());
    }
    let Some(solution) = &replayed.solution else { return };
    println!(
        "solved by {}: expected error {:.2} deg rms, sigma {:.2} deg at the worst heading; inclination {:.1} deg",
        solution.quality.method.name(),
        solution.quality.expected_rms_deg,
        solution.quality.expected_worst_deg,
        solution.calibration.inclination_rad.to_degrees(),
    );
    if let Some(Latency { found_s, sigma_s }) = solution.quality.latency {
        let used = if solution.calibration.uses_latency() { "used" } else { "not used" };
        println!("latency of the attitude: {:.0} ms, sigma {:.0} ms, {used}", found_s * 1e3, sigma_s * 1e3);
    }
    if let Some(doubt) = &solution.iron {
        println!("allowed for, {:.2} deg of it: {}", doubt.error_deg, doubt.of);
    }
    if let Some(doubt) = &solution.bank {
        println!(
            "allowed for, {:.2} deg of it: the attitude source seems to read {:.0} % of the bank ({:.1} sigma)",
            doubt.error_deg,
            100.0 * doubt.of.read,
            doubt.of.sigmas
        );
    }
    if let Some(advice) = &solution.advice {
        println!(
            "weakest: {} ({:.2} deg); best next: {} ({:.2} -> {:.2} deg)",
            advice.weakest.name(),
            advice.weakest_deg,
            advice.manoeuvre,
            advice.expected_deg,
            advice.with_it_deg
        );
    }
    if let (Some(score), Some(smooth), Some(uncorrected)) = (&replayed.score, &replayed.smooth, &replayed.uncorrected) {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(
            ["against yaw_ref_deg, deg", "rms less mean", "mean", "in 1 sigma", "in 2 sigma"].map(right_aligned),
        );
        for (name, score) in [("uncorrected", uncorrected), ("corrected, raw", score), ("corrected, smooth", smooth)] {
            let [one, two] = score
                .within_percent
                .map(|p| if p.is_finite() && name != "uncorrected" { format!("{p:.0} %") } else { String::new() });
            let cells = [name.to_owned(), format!("{:.2}", score.rms_deg), format!("{:.2}", score.mean_deg), one, two];
            table.add_row(cells.map(right_aligned));
        }
        println!("{table}");
    }
}

/// A heading for every row; the status says whether the module would have sent it.
fn write(path: &Path, shown: &[Shown]) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(out, "t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg")?;
    for row in shown {
        let status = row.status.map_or_else(NoHeading::code, |()| "ok");
        let smooth =
            row.smooth_deg.map_or_else(|| ",".to_owned(), |[deg, sigma_deg]| format!("{deg:.2},{sigma_deg:.2}"));
        writeln!(out, "{:.3},{:.2},{:.2},{status},{smooth}", row.t_s, row.heading_deg, row.sigma_deg)?;
    }
    out.flush()
}
