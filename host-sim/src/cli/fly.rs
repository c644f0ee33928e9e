//! `host-sim fly` and `host-sim emulate`.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use comfy_table::Table;
use host_sim::emulator::{self, Emulator, EmulatorError};
use host_sim::log::write::{self, FlightRecording, RecordingModule};
use host_sim::mission::{self, MissionResult, MissionStage, OutputStatistics, TurnPlan};
use host_sim::module::Module;
use host_sim::numbers::coefficients_json;
use host_sim::report::{self, ReportOrigin};
use host_sim::rig::Rig;
use host_sim::score::{ErrorStatistics, HeadingErrors};
use host_sim::transcript::SolveNotice;
use host_sim::world::WorldConfig;
use host_sim::world::aircraft::VehicleKind;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::print::{self, append_wrapped, command_line, content_table, right_aligned, write_report};
use super::termination::{SecondSignal, TerminationSignals};
use super::{Emulate, Failure, Fly, airframe_json, named_world};

const DEFAULT_REPORT: &str = "report";

pub fn run(options: &Fly) -> Result<ExitCode, Failure> {
    let (flown, recording) = recorded(&mut Rig::new(world(options)?), options);
    write_log(options, recording.as_ref())?;
    report_result(options, &flown)
}

pub fn emulate(options: &Emulate) -> Result<ExitCode, Failure> {
    let image = options.image.clone().unwrap_or_else(emulator::default_image);
    let failed = |error: EmulatorError| Failure(format!("{}: {error}", error.code()));
    let interruption = TerminationSignals::install(SecondSignal::IsIgnored)?;
    let flown = Emulator::start_until(interruption.stop(), &image, world(&options.fly)?).and_then(|mut emulator| {
        let flown = recorded(&mut emulator, &options.fly);
        emulator.take_failure().map_or(Ok(flown), Err)
    });
    if let Some(code) = interruption.exit_code() {
        return Ok(code);
    }
    let (flown, recording) = flown.map_err(failed)?;
    write_log(&options.fly, recording.as_ref())?;
    report_result(&options.fly, &flown)
}

/// The world of the options. `--aircraft` names a kind of aircraft, or, for compatibility, an airframe.
fn world(options: &Fly) -> Result<WorldConfig, Failure> {
    let named = |name: &str| named_world(name, options.seed);
    let world = match (VehicleKind::from_name(&options.aircraft), &options.airframe) {
        (Some(kind), iron) => named(iron.as_deref().unwrap_or("table1"))?.with_vehicle_kind(kind),
        (None, None) => named(&options.aircraft)?,
        (None, Some(_)) => {
            let kinds = VehicleKind::ALL.map(VehicleKind::name).join(", ");
            return Err(Failure(format!("--aircraft {}: with --airframe it is one of {kinds}", options.aircraft)));
        }
    };
    let world = if options.current > 0.0 { world.with_current_interference(options.current) } else { world };
    Ok(WorldConfig { reports_current: options.tell_current, ..world })
}

impl Fly {
    fn draws_the_airframe(&self) -> bool {
        self.airframe.as_deref().unwrap_or(&self.aircraft) == "random"
    }
}

fn report_result(options: &Fly, flown: &MissionResult) -> Result<ExitCode, Failure> {
    if options.json {
        print::print_json(summary(flown))?;
    } else {
        print::print_text(&format_result(options, flown));
    }
    let default = (!options.json).then(|| Path::new(DEFAULT_REPORT));
    if let Some(path) = options.report.as_deref().or(default) {
        write_report(&report::report_mission(flown, &made(options)), path)?;
    }
    Ok(if flown.result.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn made(options: &Fly) -> ReportOrigin {
    let setting = |name: &str, value: String| [name.to_owned(), value];
    let mut settings = vec![
        setting("aircraft", options.aircraft.clone()),
        setting("airframe", options.airframe.clone().unwrap_or_else(|| "table1".to_owned())),
        setting("seed", options.seed.to_string()),
    ];
    if options.current > 0.0 {
        let reported = if options.tell_current { ", reported" } else { "" };
        settings.push(setting("motor-current interference", format!("{} uT{reported}", options.current)));
    }
    settings.push(setting("turns", format!("{} circles each way, {} deg of bank", options.circles, options.bank)));
    ReportOrigin { command: command_line(), settings, ..ReportOrigin::default() }
}

/// Flies, recording the flight if a log was requested.
fn recorded(module: &mut impl Module, options: &Fly) -> (MissionResult, Option<FlightRecording>) {
    if options.record.is_none() {
        return (fly(module, options), None);
    }
    let mut module = RecordingModule::new(module);
    let flown = fly(&mut module, options);
    (flown, Some(module.recording))
}

fn write_log(options: &Fly, recording: Option<&FlightRecording>) -> Result<(), Failure> {
    let (Some(path), Some(recording)) = (&options.record, recording) else { return Ok(()) };
    std::fs::write(path, write::encode_for_path(path, recording))
        .map_err(|error| Failure(format!("cannot write {}: {error}; --record names another file", path.display())))
}

/// Flies with a progress bar for each stage, on the error output if that is a terminal.
fn fly(module: &mut impl Module, options: &Fly) -> MissionResult {
    const TICKS: u64 = 1000;
    let mut current: Option<(MissionStage, ProgressBar)> = None;
    let plan = TurnPlan { bank_deg: options.bank, circles: options.circles };
    let flown = mission::fly_with(module, plan, &mut |stage, fraction| {
        if current.as_ref().is_none_or(|(shown, _)| *shown != stage) {
            finish(current.take());
            let bar = ProgressBar::new(TICKS).with_message(stage.name());
            if let Ok(style) = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3} %") {
                bar.set_style(style);
            }
            current = Some((stage, bar));
        }
        if let Some((_, bar)) = &current {
            bar.set_position((fraction * TICKS as f64) as u64);
        }
    });
    finish(current);
    flown
}

fn finish(current: Option<(MissionStage, ProgressBar)>) {
    if let Some((_, bar)) = current {
        bar.finish();
    }
}

fn summary(flown: &MissionResult) -> Value {
    let (before, after) = (flown.before.statistics(), flown.after.statistics());
    let shown = flown.result.as_ref().ok();
    let refusal = match &flown.result {
        Err(SolveNotice::Refused { code, words }) => json!({ "code": code, "words": words }),
        Err(SolveNotice::Calibrated(_)) => json!({ "code": "unreadable", "words": "cal show could not be read" }),
        Ok(_) => Value::Null,
    };
    json!({
        "accepted": shown.is_some(),
        "refusal": refusal,
        "method": shown.map(|s| &s.method),
        "coefficients": shown.map(|s| coefficients_json(&s.calibration)),
        "inclination_deg": shown.map(|s| s.calibration.inclination_rad.to_degrees()),
        "expected_rms_deg": shown.map(|s| s.expected_rms_deg),
        "before": before,
        "after": shown.map(|_| after),
        "streamed": flown.streamed,
        "duration_s": flown.duration_s,
        "aircraft": flown.world.aircraft.kind.name(),
        "airframe": airframe_json(&flown.world),
        "seed": flown.world.seed,
    })
}

fn format_result(options: &Fly, flown: &MissionResult) -> String {
    let mut text = String::new();
    if options.console {
        let session = flown.transcript.replace("\r\n", "\n").replace("\r\u{1b}[2K", "");
        let _ = writeln!(text, "{session}\n");
    }
    let _ =
        writeln!(text, "Heading error in degrees, indicated less true\n{}", errors_table(&flown.before, &flown.after));
    match &flown.result {
        Ok(shown) => {
            append_wrapped(
                &mut text,
                "",
                &format!(
                    "calibrated by {}: expected error {:.2} deg rms, sigma {:.2} at the worst heading; actual {}",
                    shown.method,
                    shown.expected_rms_deg,
                    shown.expected_worst_deg,
                    words(&flown.after.statistics())
                ),
            );
            append_wrapped(&mut text, "", &format!("uncalibrated: {}", words(&flown.before.statistics())));
        }
        Err(SolveNotice::Refused { code, words }) => {
            append_wrapped(&mut text, "", &format!("the module refused: {code}: {words}"));
        }
        Err(SolveNotice::Calibrated(words)) => {
            append_wrapped(&mut text, "", &format!("calibrated, but cal show could not be read: {words}"));
        }
    }
    if let Some(streamed) = &flown.streamed {
        let OutputStatistics { headings, rms_deg, max_deg, within_percent: [one, two], .. } = streamed;
        append_wrapped(
            &mut text,
            "",
            &format!(
                "streamed after the restart: {headings} headings, {rms_deg:.2} deg rms, {max_deg:.2} at most (attitude noise \
                 and age included)"
            ),
        );
        append_wrapped(
            &mut text,
            "",
            &format!("within one and two of the sigmas sent with them: {one:.0} and {two:.0} %"),
        );
    }
    let _ = writeln!(text, "{:.0} s of flight, seed {}", flown.duration_s, flown.world.seed);
    if options.draws_the_airframe() {
        let _ = write!(text, "the airframe of this seed, as a file for --airframe:\n\n{}", flown.world.airframe_toml());
    }
    text
}

fn words(figures: &ErrorStatistics) -> String {
    format!("{:.2} rms, {:.2} at worst, {:.2} constant", figures.rms_deg, figures.max_deg, figures.mean_deg)
}

fn errors_table(before: &HeadingErrors, after: &HeadingErrors) -> Table {
    let mut table = content_table([
        "heading",
        "before:\nlevel",
        "\nright 25",
        "\nleft 25",
        "after:\nlevel",
        "\nright 25",
        "\nleft 25",
    ]);
    for step in 0..12 {
        let errors = before.0.iter().chain(&after.0).map(|bank| right_aligned(format!("{:.2}", bank[step])));
        table.add_row(std::iter::once(right_aligned(format!("{}", step * 30))).chain(errors));
    }
    table
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::cli::Cli;

    fn asked(arguments: &[&str]) -> Result<WorldConfig, String> {
        let cli = Cli::try_parse_from(std::iter::once("host-sim").chain(arguments.iter().copied()));
        world(&cli.map_err(|error| error.to_string())?.fly).map_err(|Failure(why)| why)
    }

    #[test]
    fn an_aircraft_is_a_kind_or_as_ever_the_iron_of_an_aeroplane() {
        assert_eq!(asked(&[]), Ok(WorldConfig::table1(1)));
        assert_eq!(asked(&["--aircraft", "random", "--seed", "7"]), Ok(WorldConfig::random(7)));
        assert_eq!(asked(&["--airframe", "random", "--seed", "7"]), Ok(WorldConfig::random(7)));
        for kind in VehicleKind::ALL {
            assert_eq!(asked(&["--aircraft", kind.name()]), Ok(WorldConfig::table1(1).with_vehicle_kind(kind)));
            let random = asked(&["--aircraft", kind.name(), "--airframe", "random", "--seed", "3"]);
            assert_eq!(random, Ok(WorldConfig::random(3).with_vehicle_kind(kind)));
        }
        let current = asked(&["--aircraft", "copter", "--current", "12"]);
        assert_eq!(
            current,
            Ok(WorldConfig::table1(1).with_vehicle_kind(VehicleKind::Copter).with_current_interference(12.0))
        );
    }

    #[test]
    fn what_is_no_aircraft_is_told_with_what_there_is() {
        let both = asked(&["--aircraft", "random", "--airframe", "table1"]).unwrap_err();
        assert!(both.contains("plane, copter, vtol, rover, boat"), "{both}");
        let none = asked(&["--aircraft", "zeppelin"]).unwrap_err();
        assert!(
            none.starts_with("airframe-unreadable: zeppelin: ")
                && none.contains("`copter`")
                && none.contains("`table1`"),
            "{none}"
        );
        assert!(asked(&["--current", "-1"]).is_err() && asked(&["--current", "201"]).is_err());
    }
}
