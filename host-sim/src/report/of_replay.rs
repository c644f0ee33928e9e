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
