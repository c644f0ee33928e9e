//! `host-sim replay`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use autoswing::calibration::{AttitudeLatency, MotorCurrentInterference};
use autoswing::heading::NoHeading;
use clap::ValueEnum as _;
use comfy_table::{Table, presets};
use host_sim::log::{self, Flight, LogError};
use host_sim::replay::evaluation::{
    CompassEvaluation, CorrectionSource, EvaluationOptions, FlightEvaluation, evaluate_flight, refusal,
};
use host_sim::replay::parameter_export::{self, ExportedCorrection, ParameterFormat};
use host_sim::replay::{HeadingRow, ReplayResult, summary};
use host_sim::report::{self, ReportOrigin};
use serde_json::{Value, json};

use super::print::{self, append_wrapped, command_line, right_aligned, round_to, write_report};
use super::{Failure, Replay, waiting};

pub fn run(options: &Replay) -> Result<ExitCode, Failure> {
    let name = options.file.display();
    let bar = waiting("reading the log");
    let flight = log::open(&options.file, options.unit.into(), options.system).map_err(|e| match e {
        LogError::Io(why) => {
            Failure(format!("cannot read {name}: {why}; give the path of a log, or - for standard input"))
        }
        other => Failure(format!("{name}: {other}")),
    })?;
    bar.set_message("judging its compasses");
    let verdict = evaluate_flight(
        &flight,
        &EvaluationOptions {
            selected: options.samples.into(),
            compass: options.compass,
            inclination_deg: options.inclination,
            fit_until_s: options.fit_until,
            age_s: options.age.map(|ms| ms / 1e3),
        },
    );
    bar.finish_and_clear();
    if verdict.compasses.is_empty() {
        let numbers: Vec<String> = flight.compasses.iter().map(|compass| compass.number.to_string()).collect();
        return Err(Failure(format!("{name}: the log has no compass of this number; it has {}", numbers.join(", "))));
    }
    let dialect =
        options.params_for.map_or_else(|| ParameterFormat::for_autopilot(flight.autopilot), ParameterFormat::from);
    let total_ut = verdict.earth.as_ref().map(|(earth, _)| f64::from(earth.total_ut));
    let handed = |compass: &CompassEvaluation| parameter_export::export_correction(&flight, compass, total_ut, dialect);
    if let Some(path) = &options.params {
        let handed: Vec<ExportedCorrection> = verdict.compasses.iter().filter_map(handed).collect();
        std::fs::write(path, parameter_export::format_parameter_file(&flight, &handed, dialect))
            .map_err(|e| cannot_write(path, &e))?;
    }
    if let Some(path) = &options.out {
        let shown = verdict.compasses.first().map_or(&[][..], |compass| &compass.module.headings);
        write(path, shown).map_err(|e| cannot_write(path, &e))?;
    }
    if let Some(path) = &options.report {
        let handed_over: Vec<ExportedCorrection> = verdict.compasses.iter().filter_map(handed).collect();
        let mut printed = String::new();
        write_evaluation(&mut printed, &name.to_string(), &flight, &verdict, &handed);
        let made = ReportOrigin {
            command: command_line(),
            settings: settings(options),
            terminal_output: printed,
            parameters: (!handed_over.is_empty()).then(|| {
                let end = if dialect == ParameterFormat::Inav { "txt" } else { "param" };
                [format!("compass.{end}"), parameter_export::format_parameter_file(&flight, &handed_over, dialect)]
            }),
        };
        write_report(&report::report_replay(&flight, &verdict, &name.to_string(), &made), path)?;
    }
    if options.json {
        let parameters =
            |compass: &CompassEvaluation| handed(compass).map_or(Value::Null, |handed| parameters_json(&handed));
        print::print_line(summary::json(&flight, &verdict, &parameters));
    } else {
        let mut out = String::new();
        write_evaluation(&mut out, &name.to_string(), &flight, &verdict, &handed);
        print::print_text(&out);
    }
    let is_accepted = verdict.compasses.iter().any(|compass| compass.module.accepted.is_ok());
    Ok(if is_accepted { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn settings(options: &Replay) -> Vec<[String; 2]> {
    let samples = options.samples.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    let age = options.age.map_or_else(|| "found in the flight".to_owned(), |ms| format!("{ms} ms"));
    let mut settings = vec![["samples".to_owned(), samples], ["age of the field".to_owned(), age]];
    let told = [
        ("inclination", options.inclination.map(|deg| format!("{deg} deg"))),
        ("fitted until", options.fit_until.map(|s| format!("{s} s"))),
        ("compass", options.compass.map(|number| number.to_string())),
        ("system", options.system.map(|number| number.to_string())),
    ];
    settings.extend(told.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])));
    settings
}

fn cannot_write(path: &Path, why: &std::io::Error) -> Failure {
    Failure(format!("cannot write {}: {why}", path.display()))
}

fn parameters_json(handed: &ExportedCorrection) -> Value {
    json!({
        "matrix": handed.correction.matrix.transpose().iter().map(|number| round_to(*number, 5)).collect::<Vec<_>>(),
        "offsets_ut": handed.correction.hard_iron_ut.iter().map(|number| round_to(-number, 3)).collect::<Vec<_>>(),
        "lost_rms_deg": round_to(handed.heading_loss_deg[0], 3),
        "lost_mean_deg": round_to(handed.heading_loss_deg[1], 3),
        "heading_rms_deg": handed.score.map(|score| round_to(score.rms_deg, 3)),
        "warnings": handed.warnings,
    })
}

type ExportFn<'a> = dyn Fn(&CompassEvaluation) -> Option<ExportedCorrection> + 'a;

fn write_evaluation(out: &mut String, name: &str, flight: &Flight, verdict: &FlightEvaluation, handed: &ExportFn<'_>) {
    append_wrapped(out, "", &format!("VERDICT: {}", summary::verdict_line(verdict)));
    let [from_s, to_s] = flight.time_range_s();
    let firmware = flight.firmware.as_deref().unwrap_or("firmware not named");
    append_wrapped(out, "", &format!("{name}: {}, {firmware}, {:.0} s", flight.format.name(), to_s - from_s));
    for compass in &verdict.compasses {
        out.push('\n');
        one(out, compass, verdict, handed);
    }
    if let Some(reference) = &verdict.reference {
        out.push('\n');
        let word = if reference.is_accuracy() { "Error" } else { "Disagreement" };
        append_wrapped(out, "", &format!("{word} of headings against {}, deg RMS less mean:", reference.name()));
        let _ = writeln!(out, "{}", table(verdict));
        append_wrapped(out, "", &format!("{}: {}", reference.name(), reference.limits()));
    }
    for note in summary::notes(flight, verdict) {
        append_wrapped(out, "note: ", &note);
    }
}

fn one(out: &mut String, compass: &CompassEvaluation, verdict: &FlightEvaluation, handed: &ExportFn<'_>) {
    let used = match compass.is_used {
        Some(true) => ", used by the autopilot",
        Some(false) => ", not used by the autopilot",
        None => "",
    };
    let accepted = match (compass.module.accepted.is_ok(), compass.calibrated_s()) {
        (true, Some(at_s)) => format!("would have calibrated itself after {at_s:.0} s"),
        (true, None) => "would have calibrated when asked to at the end".to_owned(),
        (false, _) => "would have been refused".to_owned(),
    };
    append_wrapped(out, "", &format!("compass {}{used}: {accepted}", compass.number));
    if let Some(refusal) = compass.refusal() {
        append_wrapped(out, "  ", &format!("{}: {refusal}", refusal.code()));
    }
    solved(out, "  ", &compass.module);
    if let Some(without_deg) = compass.rms_without_current_deg {
        append_wrapped(out, "  ", &format!("without the current, headings would err by {without_deg:.2} deg RMS"));
    }
    if compass.module.accepted.is_err() && compass.all_rows.accepted.is_ok() {
        append_wrapped(out, "  ", "all of its rows, thinned, would have been enough:");
        solved(out, "    ", &compass.all_rows);
    }
    if let (true, Some(refusal)) = (compass.module.accepted.is_ok(), refusal(&compass.all_rows)) {
        append_wrapped(out, "  ", &format!("all of its rows, thinned, would have been refused: {refusal}"));
    }
    let from = compass.latency.sigma_s.map_or_else(
        || "not found in this flight".to_owned(),
        |sigma_s| format!("found in this flight, sigma {:.0} ms", sigma_s * 1e3),
    );
    append_wrapped(
        out,
        "  ",
        &format!(
            "field {:.1} times a second, {:.0} ms old at its time stamp ({from})",
            1.0 / compass.reading_interval_s,
            compass.latency.used_s * 1e3
        ),
    );
    let counted = &compass.counts;
    let rejected = counted.rejection_texts();
    let rejected = if rejected.is_empty() { String::new() } else { format!("; rejected: {}", rejected.join(", ")) };
    append_wrapped(
        out,
        "  ",
        &format!("rows: {} usable, {} fitted to{rejected}", counted.used, compass.module.samples),
    );
    if let (Some((earth, is_valid)), Some(radius_ut)) = (&verdict.earth, compass.radius_ut) {
        let model = if *is_valid { "by the field model" } else { "by the field model, of another year" };
        append_wrapped(out, "  ", &format!("field {radius_ut:.1} uT strong, {:.1} {model}", earth.total_ut));
    }
    if let Some(change) = &compass.hard_iron_step {
        let [x, y, z] = change.step_ut;
        let size = change.size_ut();
        let when = change.at_s - compass.rows.iter().find(|row| row.usable).map_or(0.0, |row| row.t_s);
        append_wrapped(
            out,
            "  ",
            &format!(
                "its iron changed by {size:.1} uT about {when:.0} s into the flight, most on {} (x {x:+.1}, y {y:+.1}, z {z:+.1}); a drift \
                 or a current shows as a step, too",
                change.axis()
            ),
        );
        for (part, expected_deg) in compass.expected_rms_by_part_deg.iter().enumerate() {
            let words = expected_deg
                .map_or_else(|| "not enough for a calibration".to_owned(), |deg| format!("expecting {deg:.1} deg"));
            append_wrapped(
                out,
                "    ",
                &format!("the part {} it alone: {words}", if part == 0 { "before" } else { "after" }),
            );
        }
    }
    if let Some(handed) = handed(compass) {
        append_wrapped(out, "  ", &format!("as parameters: {:.2} deg RMS of it are lost", handed.heading_loss_deg[0]));
        for warning in &handed.warnings {
            append_wrapped(out, "    ", warning);
        }
    }
}

fn solved(out: &mut String, indent: &str, replayed: &ReplayResult) {
    let Some(solution) = &replayed.solution else { return };
    let quality = &solution.quality;
    append_wrapped(
        out,
        indent,
        &format!(
            "solved by {}: expected error {:.2} deg rms, sigma {:.2} deg at the worst heading; inclination {:.1} deg",
            quality.method.name(),
            quality.expected_rms_deg,
            quality.expected_worst_deg,
            solution.calibration.inclination_rad.to_degrees(),
        ),
    );
    if let Some(AttitudeLatency { estimate_s: found_s, sigma_s }) =
        quality.latency.filter(|_| solution.calibration.uses_latency())
    {
        append_wrapped(
            out,
            indent,
            &format!("latency of the attitude beyond that: {:.0} ms, sigma {:.0} ms", found_s * 1e3, sigma_s * 1e3),
        );
    }
    if let Some(words) = by_current(&solution.calibration.motor_current) {
        append_wrapped(out, indent, &words);
    }
    if let Some(doubt) = &solution.hard_iron_change {
        append_wrapped(
            out,
            indent,
            &format!("allowed for, {:.2} deg of it: {}", doubt.added_error_deg, doubt.violation),
        );
    }
    if let Some(doubt) = &solution.bank_scale_error {
        let read = 100.0 * doubt.violation.read_ratio;
        append_wrapped(
            out,
            indent,
            &format!(
                "allowed for, {:.2} deg of it: the attitude source seems to read {read:.0} % of the bank",
                doubt.added_error_deg
            ),
        );
    }
    if let Some(advice) = &solution.advice {
        append_wrapped(
            out,
            indent,
            &format!(
                "weakest: {} ({:.2} deg); best next: {} ({:.2} -> {:.2} deg)",
                advice.weakest.name(),
                advice.weakest_deg,
                advice.manoeuvre,
                advice.expected_deg,
                advice.expected_after_deg
            ),
        );
    }
}

/// Describes the motor-current interference; none without current data.
fn by_current(iron: &MotorCurrentInterference) -> Option<String> {
    let MotorCurrentInterference {
        ut_per_a: [x, y, z],
        sigma_ut_per_a,
        mean_current_a: mean_a,
        current_sigma_a: spread_a,
    } = *iron;
    if spread_a == 0.0 {
        return None;
    }
    let found = if iron.is_applied() {
        format!("iron by current: x {x:+.3}, y {y:+.3}, z {z:+.3} uT per ampere (sigma {sigma_ut_per_a:.3})")
    } else {
        format!("no iron by current that is certain (sigma {sigma_ut_per_a:.3} uT per ampere)")
    };
    Some(format!("{found}, of a current of {mean_a:.1} A that varied by {spread_a:.1} A"))
}

/// A row for each correction, a column for each compass, then percentages within one and two sigma.
fn table(verdict: &FlightEvaluation) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    let header =
        std::iter::once(String::new()).chain(verdict.compasses.iter().map(|c| format!("compass {}", c.number)));
    table.set_header(header.map(right_aligned));
    let mut add = |name: &str, cell: &dyn Fn(&CompassEvaluation) -> Option<String>| {
        let cells: Vec<Option<String>> = verdict.compasses.iter().map(cell).collect();
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| "-".to_owned()));
            table.add_row(std::iter::once(name.to_owned()).chain(cells).map(right_aligned));
        }
    };
    for by in CorrectionSource::ALL {
        add(by.name(), &|compass| Some(format!("{:.2}", compass.correction_from(by)?.score?.rms_deg)));
    }
    add("ours, smooth", &|compass| Some(format!("{:.2}", compass.module.smoothed_score?.rms_deg)));
    add("ours, mean", &|compass| {
        Some(format!("{:+.2}", compass.correction_from(CorrectionSource::Module)?.score?.mean_deg))
    });
    add("ours, in 1 and 2 sigma", &|compass| {
        let [one, two] = compass.correction_from(CorrectionSource::Module)?.score?.within_percent;
        Some(format!("{one:.0}, {two:.0} %"))
    });
    table
}

/// Writes the heading of each row; the status shows whether the module would have sent it.
fn write(path: &Path, shown: &[HeadingRow]) -> std::io::Result<()> {
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
