//! Report of a simulated mission.

use autoswing::calibration::{Calibration, Orientation};
use autoswing::frames::{Field, Level};

use super::ReportOrigin;
use super::model::{CompassReport, DeviationCurve, EventMark, ReferenceInfo, Report, ReportSample};
use crate::mission::{self, EvaluatedHeading, MissionResult, RoutineMeasurement};
use crate::numbers::format_number;
use crate::score::{BANKS_DEG, ErrorStatistics, HeadingErrors, wrap_180};
use crate::transcript::SolveNotice;

/// Makes the report of a mission.
#[must_use]
pub fn report_mission(flown: &MissionResult, made: &ReportOrigin) -> Report {
    let seed = flown.world.seed;
    let kind = flown.world.aircraft.kind.name();
    Report {
        title: format!("Simulated {kind}, seed {seed}"),
        accepted: flown.result.is_ok(),
        verdict: verdict(flown),
        figures: figures(flown),
        reference: ReferenceInfo {
            difference_name: "error",
            reference_name: "the simulator's own heading".to_owned(),
            limits: "exact field and true attitude at twelve headings; indicated less true, the constant included"
                .to_owned(),
        },
        compasses: vec![swung(flown)],
        terminal_output: Some(["Console session".to_owned(), plain(&flown.transcript)]),
        origin: [
            ["command".to_owned(), made.command.clone()],
            ["made by".to_owned(), format!("host-sim {}", env!("CARGO_PKG_VERSION"))],
            ["flight".to_owned(), format!("simulated, {} s, seed {seed}", format_number(flown.duration_s, 0))],
        ]
        .into_iter()
        .chain(made.settings.iter().cloned())
        .collect(),
        ..Report::default()
    }
}

fn verdict(flown: &MissionResult) -> String {
    match &flown.result {
        Ok(shown) => format!(
            "the module calibrated itself {} s into the flight by {}, expecting {} deg RMS; the true error is {}",
            format_number(flown.solved_s, 0),
            shown.method,
            format_number(shown.expected_rms_deg, 2),
            format_number(flown.after.statistics().rms_deg, 2)
        ),
        Err(SolveNotice::Refused { code, words }) => format!("the module refused: {code}: {words}"),
        Err(SolveNotice::Calibrated(words)) => format!("calibrated, but cal show could not be read: {words}"),
    }
}

fn figures(flown: &MissionResult) -> Vec<[String; 2]> {
    let (before, after) = (flown.before.statistics(), flown.after.statistics());
    let mut figures = vec![["before: largest error".to_owned(), format!("{} deg", format_number(before.max_deg, 2))]];
    if let Ok(shown) = &flown.result {
        figures.push(["after: largest error".to_owned(), format!("{} deg", format_number(after.max_deg, 2))]);
        figures.push(["after: RMS".to_owned(), format!("{} deg", format_number(after.rms_deg, 2))]);
        figures.push(["expected: RMS".to_owned(), format!("{} deg", format_number(shown.expected_rms_deg, 2))]);
    }
    if let Some(streamed) = &flown.streamed {
        figures.push(["streamed in flight: RMS".to_owned(), format!("{} deg", format_number(streamed.rms_deg, 2))]);
        let [one, two] = streamed.within_percent;
        figures.push([
            "within 1 and 2 sigma".to_owned(),
            format!("{} and {} %", format_number(one, 0), format_number(two, 0)),
        ]);
    }
    figures
}

fn swung(flown: &MissionResult) -> CompassReport {
    let calibration = flown.result.as_ref().ok().map(|shown| shown.calibration);
    let first_s = flown.routine_measurements.first().map_or(0.0, |glimpse| glimpse.moment.at_s);
    let glimpses = flown.routine_measurements.iter().map(|glimpse| collected_sample(glimpse, calibration.as_ref()));
    let mut moments: Vec<ReportSample> = glimpses.chain(flown.evaluated_headings.iter().map(streamed_sample)).collect();
    for moment in &mut moments {
        moment.at_s -= first_s;
    }
    let mut facts = table(flown);
    if let Ok(shown) = &flown.result {
        let Calibration { total_ut, inclination_rad, .. } = shown.calibration;
        facts.push(["field".to_owned(), format!("{} uT", format_number(f64::from(total_ut), 2))]);
        let inclination_deg = f64::from(inclination_rad.to_degrees());
        facts.push(["inclination".to_owned(), format!("{} deg", format_number(inclination_deg, 2))]);
        let worst = format_number(shown.expected_worst_deg, 2);
        facts.push(["sigma at the worst heading".to_owned(), format!("{worst} deg")]);
    }
    let expected_deg = flown.result.as_ref().ok().map(|shown| shown.expected_rms_deg);
    CompassReport {
        name: "The module's compass".to_owned(),
        accepted: flown.result.is_ok(),
        facts,
        before: lines(&flown.before),
        after: if flown.result.is_ok() { lines(&flown.after) } else { Vec::new() },
        sigma_deg: expected_deg.map_or_else(Vec::new, |deg| vec![deg; 12]),
        sigma_description: "the expected error of the calibration, RMS over all headings",
        samples: moments,
        marks: vec![EventMark {
            at_s: flown.solved_s - first_s,
            name: if flown.result.is_ok() { "calibrated, restarted" } else { "refused" }.to_owned(),
        }],
        horizontal_ut: calibration.map(|c| f64::from(c.total_ut * c.inclination_rad.cos())),
        coefficients: calibration
            .map(|Calibration { w: [x, y, z], b_ut, .. }| [x, y, z, b_ut].map(|row| row.map(f64::from))),
        ..CompassReport::default()
    }
}

fn table(flown: &MissionResult) -> Vec<[String; 2]> {
    let words = |f: ErrorStatistics| {
        format!(
            "largest {}, RMS {}, constant {}, largest less constant {} deg",
            format_number(f.max_deg, 2),
            format_number(f.rms_deg, 2),
            format_number(f.mean_deg, 2),
            format_number(f.max_demeaned_deg, 2)
        )
    };
    let mut facts = vec![["before".to_owned(), words(flown.before.statistics())]];
    if flown.result.is_ok() {
        facts.push(["after".to_owned(), words(flown.after.statistics())]);
    }
    if let Some(streamed) = &flown.streamed {
        facts.push([
            "streamed in flight, attitude noise and age included".to_owned(),
            format!(
                "{} headings, largest {}, RMS {} deg",
                streamed.headings,
                format_number(streamed.max_deg, 2),
                format_number(streamed.rms_deg, 2)
            ),
        ]);
    }
    facts
}

fn lines(errors: &HeadingErrors) -> Vec<DeviationCurve> {
    let name = |bank_deg: f64| match bank_deg {
        0.0 => "level".to_owned(),
        right if right > 0.0 => format!("right {right:.0}"),
        left => format!("left {:.0}", -left),
    };
    BANKS_DEG
        .iter()
        .zip(&errors.0)
        .map(|(bank_deg, errors)| DeviationCurve {
            name: name(*bank_deg),
            errors_deg: errors.iter().copied().map(Some).collect(),
        })
        .collect()
}

fn moment(of: &mission::TrueMoment) -> ReportSample {
    ReportSample {
        at_s: of.at_s,
        heading_deg: Some(of.heading_deg),
        roll_deg: f64::from(of.attitude.roll_rad.to_degrees()),
        pitch_deg: f64::from(of.attitude.pitch_rad.to_degrees()),
        position_m: Some(of.position_m),
        is_usable: true,
        ..ReportSample::default()
    }
}

/// Moment during the collection.
fn collected_sample(glimpse: &RoutineMeasurement, calibration: Option<&Calibration>) -> ReportSample {
    let level = |by: &Calibration| {
        glimpse.moment.attitude.level(by.apply(by.remove_motor_current(glimpse.field, glimpse.current_a)))
    };
    let before = level(&Calibration::uncalibrated(Orientation::NONE));
    let error_deg =
        |level: &Field<Level>| wrap_180(f64::from(level.heading_rad().to_degrees()) - glimpse.moment.heading_deg);
    let mut moment = ReportSample { error_before_deg: Some(error_deg(&before)), ..moment(&glimpse.moment) };
    moment.set_level_field(before, calibration.map(|by| (level(by), by)));
    moment
}

/// Moment after the calibration, with the streamed heading but no field.
fn streamed_sample(told: &EvaluatedHeading) -> ReportSample {
    ReportSample { error_deg: Some(told.error_deg), sigma_deg: Some(told.sigma_deg), ..moment(&told.moment) }
}

/// Terminal text without control sequences.
fn plain(session: &str) -> String {
    session.replace("\r\u{1b}[2K", "").replace('\r', "")
}
