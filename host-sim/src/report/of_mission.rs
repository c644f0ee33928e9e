//! The report of a simulated mission.

use autoswing::calibration::{Calibration, Orientation};
use autoswing::frames::{Field, Level};

use super::Made;
use super::model::{Compared, Line, Mark, Moment, Report, Swung};
use super::text::number;
use crate::mission::{self, Flown, Glimpse, Told};
use crate::score::{BANKS_DEG, Errors, Figures, wrap_180};
use crate::transcript::Notice;

/// What came of a mission.
#[must_use]
pub fn of_mission(flown: &Flown, made: &Made) -> Report {
    let seed = flown.world.seed;
    let kind = flown.world.aircraft.kind.name();
    Report {
        title: format!("Simulated {kind}, seed {seed}"),
        accepted: flown.result.is_ok(),
        verdict: verdict(flown),
        figures: figures(flown),
        compared: Compared {
            word: "error",
            with: "the simulator's own heading".to_owned(),
            limits: "exact field and true attitude at twelve headings; indicated less true, the constant included"
                .to_owned(),
        },
        compasses: vec![swung(flown)],
        printed: Some(["Console session".to_owned(), plain(&flown.session)]),
        made: [
            ["command".to_owned(), made.command.clone()],
            ["made by".to_owned(), format!("host-sim {}", env!("CARGO_PKG_VERSION"))],
            ["flight".to_owned(), format!("simulated, {} s, seed {seed}", number(flown.duration_s, 0))],
        ]
        .into_iter()
        .chain(made.settings.iter().cloned())
        .collect(),
        ..Report::default()
    }
}

fn verdict(flown: &Flown) -> String {
    match &flown.result {
        Ok(shown) => format!(
            "the module calibrated itself {} s into the flight by {}, expecting {} deg RMS; the true error is {}",
            number(flown.solved_s, 0),
            shown.method,
            number(shown.expected_rms_deg, 2),
            number(flown.after.figures().rms_deg, 2)
        ),
        Err(Notice::Refused { code, words }) => format!("the module refused: {code}: {words}"),
        Err(Notice::Calibrated(words)) => format!("calibrated, but cal show could not be read: {words}"),
    }
}

fn figures(flown: &Flown) -> Vec<[String; 2]> {
    let (before, after) = (flown.before.figures(), flown.after.figures());
    let mut figures = vec![["before: largest error".to_owned(), format!("{} deg", number(before.max_deg, 2))]];
    if let Ok(shown) = &flown.result {
        figures.push(["after: largest error".to_owned(), format!("{} deg", number(after.max_deg, 2))]);
        figures.push(["after: RMS".to_owned(), format!("{} deg", number(after.rms_deg, 2))]);
        figures.push(["expected: RMS".to_owned(), format!("{} deg", number(shown.expected_rms_deg, 2))]);
    }
    if let Some(streamed) = &flown.streamed {
        figures.push(["streamed in flight: RMS".to_owned(), format!("{} deg", number(streamed.rms_deg, 2))]);
        let [one, two] = streamed.within_percent;
        figures.push(["within 1 and 2 sigma".to_owned(), format!("{} and {} %", number(one, 0), number(two, 0))]);
    }
    figures
}

fn swung(flown: &Flown) -> Swung {
    let calibration = flown.result.as_ref().ok().map(|shown| shown.calibration);
    let first_s = flown.glimpses.first().map_or(0.0, |glimpse| glimpse.moment.at_s);
    let glimpses = flown.glimpses.iter().map(|glimpse| seen(glimpse, calibration.as_ref()));
    let mut moments: Vec<Moment> = glimpses.chain(flown.told.iter().map(told)).collect();
    for moment in &mut moments {
        moment.at_s -= first_s;
    }
    let mut facts = table(flown);
    if let Ok(shown) = &flown.result {
        let Calibration { total_ut, inclination_rad, .. } = shown.calibration;
        facts.push(["field".to_owned(), format!("{} uT", number(f64::from(total_ut), 2))]);
        let inclination_deg = f64::from(inclination_rad.to_degrees());
        facts.push(["inclination".to_owned(), format!("{} deg", number(inclination_deg, 2))]);
        let worst = number(shown.expected_worst_deg, 2);
        facts.push(["sigma at the worst heading".to_owned(), format!("{worst} deg")]);
    }
    let expected_deg = flown.result.as_ref().ok().map(|shown| shown.expected_rms_deg);
    Swung {
        name: "The module's compass".to_owned(),
        accepted: flown.result.is_ok(),
        facts,
        before: lines(&flown.before),
        after: if flown.result.is_ok() { lines(&flown.after) } else { Vec::new() },
        sigma_deg: expected_deg.map_or_else(Vec::new, |deg| vec![deg; 12]),
        sigma_of: "the expected error of the calibration, RMS over all headings",
        moments,
        marks: vec![Mark {
            at_s: flown.solved_s - first_s,
            name: if flown.result.is_ok() { "calibrated, restarted" } else { "refused" }.to_owned(),
        }],
        horizontal_ut: calibration.map(|c| f64::from(c.total_ut * c.inclination_rad.cos())),
        coefficients: calibration
            .map(|Calibration { w: [x, y, z], b_ut, .. }| [x, y, z, b_ut].map(|row| row.map(f64::from))),
        ..Swung::default()
    }
}

/// Before and after in figures.
fn table(flown: &Flown) -> Vec<[String; 2]> {
    let words = |f: Figures| {
        format!(
            "largest {}, RMS {}, constant {}, largest less constant {} deg",
            number(f.max_deg, 2),
            number(f.rms_deg, 2),
            number(f.mean_deg, 2),
            number(f.max_demeaned_deg, 2)
        )
    };
    let mut facts = vec![["before".to_owned(), words(flown.before.figures())]];
    if flown.result.is_ok() {
        facts.push(["after".to_owned(), words(flown.after.figures())]);
    }
    if let Some(streamed) = &flown.streamed {
        facts.push([
            "streamed in flight, attitude noise and age included".to_owned(),
            format!(
                "{} headings, largest {}, RMS {} deg",
                streamed.headings,
                number(streamed.max_deg, 2),
                number(streamed.rms_deg, 2)
            ),
        ]);
    }
    facts
}

fn lines(errors: &Errors) -> Vec<Line> {
    let name = |bank_deg: f64| match bank_deg {
        0.0 => "level".to_owned(),
        right if right > 0.0 => format!("right {right:.0}"),
        left => format!("left {:.0}", -left),
    };
    BANKS_DEG
        .iter()
        .zip(&errors.0)
        .map(|(bank_deg, errors)| Line {
            name: name(*bank_deg),
            errors_deg: errors.iter().copied().map(Some).collect(),
        })
        .collect()
}

fn moment(of: &mission::Moment) -> Moment {
    Moment {
        at_s: of.at_s,
        heading_deg: Some(of.heading_deg),
        roll_deg: f64::from(of.attitude.roll_rad.to_degrees()),
        pitch_deg: f64::from(of.attitude.pitch_rad.to_degrees()),
        place_m: Some(of.place_m),
        is_usable: true,
        ..Moment::default()
    }
}

/// What was seen while it collected.
fn seen(glimpse: &Glimpse, calibration: Option<&Calibration>) -> Moment {
    let level = |by: &Calibration| {
        glimpse.moment.attitude.level(by.apply(by.without_current(glimpse.field, glimpse.current_a)))
    };
    let before = level(&Calibration::uncalibrated(Orientation::NONE));
    let error_deg =
        |level: &Field<Level>| wrap_180(f64::from(level.heading_rad().to_degrees()) - glimpse.moment.heading_deg);
    let mut moment = Moment { before_deg: Some(error_deg(&before)), ..moment(&glimpse.moment) };
    moment.see(before, calibration.map(|by| (level(by), by)));
    moment
}

/// What was told afterwards. It is no part of the picture of what was collected, but of the map and of the errors.
fn told(told: &Told) -> Moment {
    Moment { error_deg: Some(told.error_deg), sigma_deg: Some(told.sigma_deg), ..moment(&told.moment) }
}

/// A terminal's text without its control sequences.
fn plain(session: &str) -> String {
    session.replace("\r\u{1b}[2K", "").replace('\r', "")
}
