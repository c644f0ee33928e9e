//! The report of a replayed log.

use autoswing::calibration::{Calibration, Solution};
use autoswing::frames::{Body, Field};

use super::Made;
use super::model::{Compared, Line, Mark, Methods, Moment, Report, Swung, by_heading};
use super::text::{each, number};
use crate::log::{Flight, Gps};
use crate::replay::judge::{By, Judged, Verdict, refusal};
use crate::replay::{Replayed, Row, Shown, levelled, told};
use crate::score::wrap_180;

/// What came of a log.
#[must_use]
pub fn of_replay(flight: &Flight, verdict: &Verdict, log: &str, made: &Made) -> Report {
    let [from_s, to_s] = flight.lasts_s();
    let firmware = flight.firmware.as_deref().unwrap_or("firmware not named");
    let lines = [
        ("command", made.command.clone()),
        ("made by", format!("host-sim {}", env!("CARGO_PKG_VERSION"))),
        ("log", format!("{log}: {}, {firmware}, {} s", flight.format.name(), number(to_s - from_s, 0))),
    ];
    Report {
        title: format!("Flight {}", log.rsplit(['/', '\\']).next().unwrap_or(log)),
        accepted: verdict.compasses.iter().any(|compass| compass.module.accepted.is_ok()),
        verdict: told::verdict(verdict),
        figures: figures(verdict),
        notes: told::notes(flight, verdict),
        compared: compared(verdict),
        methods: methods(verdict),
        compasses: verdict.compasses.iter().map(|compass| swung(flight, verdict, compass)).collect(),
        parameters: made.parameters.clone(),
        printed: Some(["As the command prints it".to_owned(), made.printed.clone()]),
        made: lines
            .map(|(what, value)| [what.to_owned(), value])
            .into_iter()
            .chain(made.settings.iter().cloned())
            .collect(),
    }
}

fn compared(verdict: &Verdict) -> Compared {
    match &verdict.reference {
        Some(reference) => Compared {
            word: if reference.is_accuracy() { "error" } else { "disagreement" },
            with: reference.name().to_owned(),
            limits: format!("{}; less the mean", reference.limits()),
        },
        None => Compared {
            word: "correction",
            with: "the module's own heading".to_owned(),
            limits: "the log has no heading to compare with: shown is what the module would have changed".to_owned(),
        },
    }
}

/// A row for each calibrator, a column for each compass.
fn methods(verdict: &Verdict) -> Methods {
    const WHOSE: [By; 6] = [By::Nobody, By::Autopilot, By::Sphere, By::Ellipsoid, By::Module, By::ModuleOfAll];
    let rows = WHOSE.map(|by| {
        let of = |compass: &Judged| compass.by(by)?.score.map(|score| score.rms_deg);
        (by.name().to_owned(), verdict.compasses.iter().map(of).collect::<Vec<_>>())
    });
    Methods {
        compasses: verdict.compasses.iter().map(|compass| format!("compass {}", compass.number)).collect(),
        rows: rows.into_iter().filter(|(_, cells)| cells.iter().any(Option::is_some)).collect(),
    }
}

/// Of the compass that matters most: the first that was accepted, else the first.
fn figures(verdict: &Verdict) -> Vec<[String; 2]> {
    let is_accepted = |compass: &&Judged| compass.module.accepted.is_ok();
    let Some(compass) = verdict.compasses.iter().find(is_accepted).or(verdict.compasses.first()) else {
        return Vec::new();
    };
    let number_of = compass.number;
    let mut figures = Vec::new();
    let mut add = |what: String, value: Option<f64>, decimals: usize, unit: &str| {
        if let Some(value) = value {
            figures.push([what, format!("{} {unit}", number(value, decimals))]);
        }
    };
    add(format!("compass {number_of}: calibrated after"), compass.calibrated_s(), 0, "s");
    let solution = compass.module.solution.as_ref();
    add("expected error, RMS".to_owned(), solution.map(|s| f64::from(s.quality.expected_rms_deg)), 2, "deg");
    let word = compared(verdict).word;
    let of = |by: By| compass.by(by)?.score.map(|score| score.rms_deg);
    add(format!("{word} as logged, RMS"), of(By::Autopilot).or(of(By::Nobody)), 2, "deg");
    add(format!("{word} with ours, RMS"), of(By::Module), 2, "deg");
    figures
}

/// What is shown of a compass: what the module would have solved, or, if nothing, what all rows give.
fn shown_of(compass: &Judged) -> &Replayed {
    if compass.module.solution.is_some() { &compass.module } else { &compass.all }
}

fn swung(flight: &Flight, verdict: &Verdict, compass: &Judged) -> Swung {
    let replayed = shown_of(compass);
    let solution = replayed.solution.as_ref();
    let has_reference = verdict.reference.is_some();
    let mut swung = Swung {
        name: format!("Compass {}", compass.number),
        accepted: compass.module.accepted.is_ok(),
        facts: facts(verdict, compass),
        sigma_of: "the mean sigma that the module tells with its headings",
        moments: moments(flight, compass, replayed, has_reference),
        marks: marks(compass),
        horizontal_ut: solution.map(|s| {
            let Calibration { total_ut, inclination_rad, .. } = s.calibration;
            f64::from(total_ut * inclination_rad.cos())
        }),
        knows_fitted: true,
        advice: solution.and_then(|s| s.advice).map(|advice| {
            let [now, then] = [advice.expected_deg, advice.with_it_deg].map(|deg| number(f64::from(deg), 2));
            format!("{} ({now} to {then} deg)", advice.manoeuvre)
        }),
        coefficients: solution.map(|s| {
            let Calibration { w: [x, y, z], b_ut, .. } = s.calibration;
            [x, y, z, b_ut].map(|row| row.map(f64::from))
        }),
        ..Swung::default()
    };
    let [before, after] = swung.take_out_the_mean();
    for (what, mean) in [("mean as logged, taken out", before), ("mean with ours, taken out", after)] {
        if let Some(mean) = mean {
            swung.facts.push([what.to_owned(), format!("{} deg, declination included", number(mean, 2))]);
        }
    }
    let line = |name: &str, of: fn(&Moment) -> Option<f64>| {
        let errors_deg = by_heading(&swung.moments, of);
        errors_deg.iter().any(Option::is_some).then(|| Line { name: name.to_owned(), errors_deg })
    };
    let ours = if replayed.accepted.is_ok() { "ours" } else { "ours, but refused" };
    let (before, after) =
        (line(logged_by(compass).name(), |moment| moment.before_deg), line(ours, |moment| moment.error_deg));
    (swung.before, swung.after) = (before.into_iter().collect(), after.into_iter().collect());
    if solution.is_some() {
        let sigma = by_heading(&swung.moments, |moment| moment.sigma_deg);
        swung.sigma_deg = sigma.into_iter().map(|sigma| sigma.unwrap_or(f64::NAN)).collect();
    }
    swung
}

/// Whose correction the log has.
fn logged_by(compass: &Judged) -> By {
    if compass.by(By::Autopilot).is_some() { By::Autopilot } else { By::Nobody }
}

fn marks(compass: &Judged) -> Vec<Mark> {
    let first_s = compass.rows.first().map_or(0.0, |row| row.t_s);
    let calibrated = compass.module.ended_s.map(|at_s| Mark {
        at_s,
        name: if compass.module.accepted.is_ok() { "would have calibrated" } else { "would have solved" }.to_owned(),
    });
    let changed = compass.change.as_ref().map(|change| Mark {
        at_s: change.at_s - first_s,
        name: format!("iron changed by {} uT, most on {}", number(change.size_ut(), 1), change.axis()),
    });
    calibrated.into_iter().chain(changed).collect()
}

fn moments(flight: &Flight, compass: &Judged, replayed: &Replayed, has_reference: bool) -> Vec<Moment> {
    let Some(first) = compass.rows.first() else { return Vec::new() };
    let places = Places::of(flight);
    let is_logged = logged_by(compass) == By::Autopilot;
    let mut moments: Vec<Moment> = compass
        .rows
        .iter()
        .enumerate()
        .map(|(i, row)| {
            let shown = replayed.shown.get(i);
            let mut moment = moment(row, is_logged, replayed.solution.as_ref(), shown, has_reference);
            moment.at_s = row.t_s - first.t_s;
            moment.place_m = places.as_ref().and_then(|places| places.at(flight, row.t_s));
            moment
        })
        .collect();
    for fitted_s in &replayed.fitted_s {
        // The nearest row: samples are means of readings, and their clock counts milliseconds.
        let after = moments.partition_point(|moment| moment.at_s < *fitted_s).min(moments.len() - 1);
        let near = [after.saturating_sub(1), after];
        let off = |i: &usize| moments.get(*i).map_or(f64::INFINITY, |moment| (moment.at_s - fitted_s).abs());
        let nearest = near.into_iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        if let Some(moment) = nearest.and_then(|nearest| moments.get_mut(nearest)) {
            moment.is_fitted = true;
        }
    }
    moments
}

fn moment(row: &Row, is_logged: bool, solution: Option<&Solution>, shown: Option<&Shown>, compares: bool) -> Moment {
    let raw: Field<Body> = Field::new(if is_logged { row.logged.ut } else { row.field.ut });
    let before = row.attitude.level(raw);
    let before_deg = f64::from(before.heading_rad().to_degrees());
    let ours_deg = shown.map(|shown| shown.heading_deg).filter(|deg| deg.is_finite());
    let with_deg = if compares { row.reference_deg } else { ours_deg };
    let error_deg = |heading_deg: f64| Some(wrap_180(heading_deg - with_deg?));
    let mut moment = Moment {
        heading_deg: row.reference_deg.or(ours_deg).or(Some(before_deg)).map(|deg| deg.rem_euclid(360.0)),
        roll_deg: f64::from(row.attitude.roll_rad.to_degrees()),
        pitch_deg: f64::from(row.attitude.pitch_rad.to_degrees()),
        before_deg: error_deg(before_deg),
        error_deg: ours_deg.filter(|_| compares).and_then(error_deg),
        sigma_deg: shown.map(|shown| shown.sigma_deg).filter(|deg| deg.is_finite()),
        is_usable: row.usable,
        is_silent: shown.is_some_and(|shown| shown.status.is_err()),
        ..Moment::default()
    };
    let after = solution.map(|solution| (levelled(&solution.calibration, row), &solution.calibration));
    moment.see(before, after);
    moment
}

/// Positions as metres from the first.
struct Places {
    first: [f64; 2],
    metres: [f64; 2],
}

impl Places {
    /// Of a degree of latitude.
    const METRES: f64 = 111_195.0;
    const MAX_GAP_S: f64 = 3.0;

    fn of(flight: &Flight) -> Option<Self> {
        let is_place = |gps: &Gps| gps.latitude_deg.abs() + gps.longitude_deg.abs() > 0.0;
        let first = flight.gps.rows().iter().map(|row| Gps::from_columns(row.of)).find(is_place)?;
        let first = [first.longitude_deg, first.latitude_deg].map(f64::from);
        Some(Self { first, metres: [Self::METRES * first[1].to_radians().cos(), Self::METRES] })
    }

    /// East and north.
    fn at(&self, flight: &Flight, t_s: f64) -> Option<[f64; 2]> {
        let (before, after, part) = flight.gps.between(t_s, Self::MAX_GAP_S)?;
        let [before, after] = [before, after].map(|row| {
            let gps = Gps::from_columns(row.of);
            [gps.longitude_deg, gps.latitude_deg].map(f64::from)
        });
        Some(std::array::from_fn(|axis| {
            let degrees = before[axis] + part * wrap_180(after[axis] - before[axis]);
            wrap_180(degrees - self.first[axis]) * self.metres[axis]
        }))
    }
}

/// What there is to say of a compass.
fn facts(verdict: &Verdict, compass: &Judged) -> Vec<[String; 2]> {
    let mut facts: Vec<[String; 2]> = Vec::new();
    let mut add = |what: &str, value: String| facts.push([what.to_owned(), value]);
    let accepted = match (refusal(&compass.module), compass.calibrated_s()) {
        (Some(refusal), _) => format!("would have been refused: {}: {refusal}", refusal.code()),
        (None, Some(at_s)) => format!("would have calibrated itself after {} s", number(at_s, 0)),
        (None, None) => "would have calibrated when asked to at the end".to_owned(),
    };
    add("verdict", accepted);
    match compass.is_used {
        Some(true) => add("autopilot", "uses it for its heading".to_owned()),
        Some(false) => add("autopilot", "does not use it".to_owned()),
        None => {}
    }
    if let Some(solution) = &shown_of(compass).solution {
        let of = if compass.module.solution.is_some() { "" } else { ", of all rows" };
        let quality = &solution.quality;
        add("solved by", format!("{}{of}", quality.method.name()));
        let [rms, worst] = [quality.expected_rms_deg, quality.expected_worst_deg].map(|deg| number(f64::from(deg), 2));
        add("expected error", format!("{rms} deg RMS, sigma {worst} at the worst heading"));
        if let Some(advice) = &solution.advice {
            let weakest = number(f64::from(advice.weakest_deg), 2);
            add("weakest", format!("{} ({weakest} deg)", advice.weakest.name()));
        }
        if let Some(doubt) = &solution.iron {
            add("allowed for", format!("{} deg: {}", number(f64::from(doubt.error_deg), 2), doubt.of));
        }
    }
    let age = number(compass.age.used_s * 1e3, 0);
    add("field", format!("{} times a second, {age} ms old at its time stamp", number(1.0 / compass.every_s, 1)));
    if let (Some((earth, is_valid)), Some(radius_ut)) = (&verdict.earth, compass.radius_ut) {
        let year = if *is_valid { "" } else { ", of another year" };
        let model = number(f64::from(earth.total_ut), 1);
        add("strength", format!("{} uT, {model} by the field model{year}", number(radius_ut, 1)));
    }
    let counted = &compass.counted;
    let rejected = each(counted.rejected(), |rejected| format!("; {rejected}"));
    add("rows", format!("{} usable, {} fitted to{rejected}", counted.used, compass.module.samples));
    facts
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use autoswing::calibration::SolveError;
    use autoswing::earth::{Day, EarthField, Place};

    use super::*;
    use crate::log::csv::Unit;
    use crate::log::write::{Recording, dataflash, turns};
    use crate::log::{self, Parameters};
    use crate::replay::change::Change;
    use crate::replay::judge::{Asked, judge};
    use crate::replay::{Reference, Refused, Selected};
    use crate::world::WorldConfig;

    /// A flight whose autopilot had offsets, judged.
    static FLOWN: LazyLock<(Flight, Verdict)> = LazyLock::new(|| {
        let parameters = ["X", "Y", "Z"].map(|axis| (format!("COMPASS_OFS_{axis}"), 100.0)).to_vec();
        let recording = Recording { parameters, ..turns(&WorldConfig::table1(1), 0.0) };
        let flight = log::read(&mut dataflash(&recording).as_slice(), Unit::Milligauss).unwrap();
        let verdict = judge(&flight, &Asked { selected: Selected::Flight, age_s: Some(0.0), ..Asked::OF_THE_LOG });
        (flight, verdict)
    });

    /// The report of that flight, changed in one thing.
    fn report(change: impl Fn(&mut Flight, &mut Verdict)) -> Report {
        let (mut flight, mut verdict) = FLOWN.clone();
        change(&mut flight, &mut verdict);
        of_replay(&flight, &verdict, "flight.bin", &Made::default())
    }

    const REFUSED: Result<(), Refused> = Err(Refused::Solve(SolveError::NotConverged));

    fn fact(report: &Report, what: &str) -> Option<String> {
        report.compasses[0].facts.iter().find(|[name, _]| name == what).map(|[_, words]| words.clone())
    }

    /// A heading by what was refused is not called the module's own without saying so, nor is its solve a calibration.
    #[test]
    fn what_was_refused_is_called_so() {
        let taken = report(|_, _| {});
        let refused = report(|_, verdict| verdict.compasses[0].module.accepted = REFUSED);
        for (report, line, mark, words) in [
            (&taken, "ours", "would have calibrated", "would have calibrated itself after"),
            (&refused, "ours, but refused", "would have solved", "would have been refused: not-converged"),
        ] {
            let compass = &report.compasses[0];
            assert_eq!((compass.after[0].name.as_str(), compass.marks[0].name.as_str()), (line, mark));
            assert!(fact(report, "verdict").unwrap().starts_with(words), "{:?}", compass.facts);
        }
        assert!(taken.accepted && !refused.accepted);
        let asked = report(|_, verdict| verdict.compasses[0].module.ended_s = None);
        assert!(asked.compasses[0].marks.is_empty());
        assert_eq!(fact(&asked, "verdict").unwrap(), "would have calibrated when asked to at the end");
    }

    /// Marks stand on the axis of the page, which begins with the first row.
    #[test]
    fn marks_are_where_it_happened() {
        let report = report(|_, verdict| {
            let compass = &mut verdict.compasses[0];
            // The log begins half a minute before the first row.
            compass.rows.drain(..300);
            let at_s = compass.rows[0].t_s + 50.0;
            compass.module.ended_s = Some(90.0);
            compass.change = Some(Change { at_s, ut: [1.0, -8.0, 0.0], sigma_ut: [0.1; 3] });
        });
        let [calibrated, changed] = report.compasses[0].marks.as_slice() else { panic!("two marks") };
        assert!((calibrated.at_s - 90.0).abs() < 1e-9 && (changed.at_s - 50.0).abs() < 1e-9);
        assert_eq!(changed.name, "iron changed by 8.1 uT, most on y");
    }

    /// A field model of another year is good to a tenth of a microtesla a year: that it is one is told.
    #[test]
    fn a_field_model_of_another_year_is_told() {
        for (is_valid, words) in [(true, "by the field model"), (false, "by the field model, of another year")] {
            let report = report(|_, verdict| {
                let day = Day::from_unix_s(1_767_484_800).unwrap();
                let earth = EarthField::of(Place::new(48.0, 11.3, 500.0).unwrap(), day).unwrap();
                verdict.earth = Some((earth, is_valid));
            });
            assert!(fact(&report, "strength").unwrap().ends_with(words), "{words}");
        }
    }

    /// What was before is what the autopilot had: its own correction where it made one, else the field as it is measured.
    #[test]
    fn before_is_what_the_autopilot_had() {
        let logged = report(|_, _| {});
        let raw = report(|_, verdict| verdict.compasses[0].corrections.retain(|of| of.by != By::Autopilot));
        let rows = &FLOWN.1.compasses[0].rows;
        for (report, name, is_logged) in [(&logged, "as logged", true), (&raw, "raw", false)] {
            let compass = &report.compasses[0];
            assert_eq!(compass.before[0].name, name);
            // Errors are less their mean: what one row differs by from another is what its field says.
            let heading_deg = |i: usize| {
                let row = &rows[i];
                let field = Field::<Body>::new(if is_logged { row.logged.ut } else { row.field.ut });
                f64::from(row.attitude.level(field).heading_rad().to_degrees()) - row.reference_deg.unwrap()
            };
            let shown = |i: usize| compass.moments[i].before_deg.unwrap();
            let off_deg = wrap_180(shown(500) - shown(1500) - (heading_deg(500) - heading_deg(1500)));
            assert!(off_deg.abs() < 1e-6, "{name}: {off_deg}");
        }
        assert!(figure(&logged, "as logged") != figure(&raw, "as logged"), "{:?}", raw.figures);
    }

    fn figure(report: &Report, what: &str) -> String {
        report.figures.iter().find(|[name, _]| name.contains(what)).map(|[_, value]| value.clone()).unwrap_or_default()
    }

    /// Errors are told of a reference that is one; against the autopilot's yaw it is disagreement, and against nothing what
    /// the module would have changed.
    #[test]
    fn errors_are_called_what_they_are() {
        let of = |reference: Option<Reference>| {
            report(|_, verdict| {
                verdict.reference = reference.clone();
                if verdict.reference.is_none() {
                    verdict.compasses[0].rows.iter_mut().for_each(|row| row.reference_deg = None);
                }
            })
        };
        for (reference, word) in [
            (Some(Reference::Simulator), "error"),
            (Some(Reference::AutopilotYaw), "disagreement"),
            (None, "correction"),
        ] {
            let report = of(reference.clone());
            assert_eq!(report.compared.word, word);
            assert!(!figure(&report, &format!("{word} as logged")).is_empty(), "{:?}", report.figures);
            let usable = || report.compasses[0].moments.iter().filter(|moment| moment.is_usable).skip(20);
            assert_eq!(usable().all(|moment| moment.error_deg.is_some()), reference.is_some(), "{word}");
            // Without any, it is what ours and the autopilot's headings differ by, in which there is no error of ours.
            assert!(usable().all(|moment| moment.before_deg.is_some()), "{word}");
            assert_eq!(report.compasses[0].after.is_empty(), reference.is_none(), "{word}");
        }
    }

    /// Whether the autopilot's heading is made with it is told where that is known.
    #[test]
    fn whether_the_autopilot_uses_it_is_told() {
        for (is_used, words) in
            [(Some(true), Some("uses it for its heading")), (Some(false), Some("does not use it")), (None, None)]
        {
            let report = report(|flight, verdict| {
                flight.parameters = Parameters::default();
                verdict.compasses[0].is_used = is_used;
            });
            assert_eq!(fact(&report, "autopilot").as_deref(), words);
        }
    }
}
