//! A flight, compass by compass: what each had, what other calibrators make of it, and what the module would have.

use autoswing::calibration::Advice;
use autoswing::collection::Lack;
use autoswing::compass::Refusal;
use autoswing::earth::{Day, EarthField, Place};
use autoswing::frames::{Body, Field};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::age::{self, Age};
use super::change::{self, Change};
use super::{
    Counted, Options, Reference, Refused, Replayed, Row, Score, Selected, fits, replay_with, rows, score, solved_of_all,
};
use crate::log::{Compass, Flight, Gps, Iron};

/// How to judge.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Which rows the module is given.
    pub selected: Selected,
    /// Only this compass.
    pub compass: Option<u8>,
    /// Inclination of the Earth field there, degrees; else that of the field model where place and day are known.
    pub inclination_deg: Option<f64>,
    /// Rows from this time on are not fitted to, seconds.
    pub fit_until_s: Option<f64>,
    /// How old the logged field is, seconds; else it is found.
    pub age_s: Option<f64>,
}

impl Asked {
    /// What the module would have done by itself, with all compasses and all that the log tells.
    pub const OF_THE_LOG: Self =
        Self { selected: Selected::Flight, compass: None, inclination_deg: None, fit_until_s: None, age_s: None };
}

/// A compass, judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// As the autopilot counts them.
    pub number: u8,
    /// Whether the autopilot's heading is made with it.
    pub is_used: Option<bool>,
    /// How old its logged field is.
    pub age: Age,
    /// Its rows.
    pub rows: Vec<Row>,
    /// How many there are.
    pub counted: Counted,
    /// Time between its readings, as most are, seconds.
    pub every_s: f64,
    /// What the module makes of the rows that were asked for.
    pub module: Replayed,
    /// What it makes of all of them.
    pub all: Replayed,
    /// How good its headings are without what it found to go with the current, in degrees RMS less mean; none where it
    /// found none, and without a reference.
    pub without_current_deg: Option<f64>,
    /// Each correction and how good its headings are.
    pub corrections: Vec<Correction>,
    /// How strong the field is by the fit of a sphere, which hard iron does not change, microtesla.
    pub radius_ut: Option<f64>,
    /// A step of its iron in flight.
    pub change: Option<Change>,
    /// What the parts before and after that give alone, expected degrees RMS; none of one that gives nothing.
    pub parts: Vec<Option<f64>>,
}

/// A correction for iron, tried.
#[derive(Clone, Debug)]
pub struct Correction {
    /// Whose it is.
    pub by: By,
    /// What it is; none where it changed in flight.
    pub iron: Option<Iron>,
    /// How good its headings are; none without a reference.
    pub score: Option<Score>,
}

/// Whose a correction is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// The field as it is measured.
    Nobody,
    /// The autopilot's parameters.
    Autopilot,
    /// The best sphere.
    Sphere,
    /// The best ellipsoid.
    Ellipsoid,
    /// The module, of what it was asked to take.
    Module,
    /// The module, of all rows.
    ModuleOfAll,
}

impl By {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nobody => "raw",
            Self::Autopilot => "as logged",
            Self::Sphere => "sphere",
            Self::Ellipsoid => "ellipsoid",
            Self::Module => "ours",
            Self::ModuleOfAll => "ours, all rows",
        }
    }
}

/// A flight, judged.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// The compasses.
    pub compasses: Vec<Judged>,
    /// What headings are compared with.
    pub reference: Option<Reference>,
    /// The Earth's field where it was flown, by the field model, and whether the model holds on that day.
    pub earth: Option<(EarthField, bool)>,
    /// Time between two attitudes, as most are, seconds.
    pub attitude_every_s: f64,
}

/// Judges a flight.
#[must_use]
pub fn judge(flight: &Flight, asked: &Asked) -> Verdict {
    let reference = Reference::best(flight);
    let earth = earth(flight);
    let compasses: Vec<&Compass> =
        flight.compasses.iter().filter(|compass| asked.compass.is_none_or(|number| compass.number == number)).collect();
    let told = |used_s: f64| Age { used_s, sigma_s: None };
    let mut ages: Vec<Age> =
        compasses.par_iter().map(|compass| asked.age_s.map_or_else(|| age::found(flight, compass), told)).collect();
    age::shared(&mut ages);
    let options = Options {
        selected: asked.selected,
        inclination_deg: asked.inclination_deg,
        here: place(flight).zip(flight.day),
        fit_until_s: asked.fit_until_s,
    };
    let compasses: Vec<Judged> = compasses
        .par_iter()
        .zip(ages)
        .map(|(compass, age)| judged(flight, compass, age, reference.as_ref(), &options))
        .collect();
    Verdict { compasses, reference, earth, attitude_every_s: flight.attitude.median_step_s().unwrap_or(f64::NAN) }
}

fn judged(flight: &Flight, compass: &Compass, age: Age, reference: Option<&Reference>, options: &Options) -> Judged {
    let (rows, counted) = rows(flight, compass, age.used_s, reference);
    let module = replay_with(&rows, Some(flight), options);
    let all = if options.selected == Selected::All {
        module.clone()
    } else {
        replay_with(&rows, Some(flight), &Options { selected: Selected::All, ..*options })
    };
    let without_current_deg = without_current_deg(&rows, flight, &module, options);
    let fields: Vec<Vector3<f64>> =
        rows.iter().filter(|row| row.usable).map(|row| row.field.ut.map(f64::from)).collect();
    let of = |by, iron: Option<Iron>| Correction { by, iron, score: iron.and_then(|iron| scored(&rows, &iron)) };
    let logged = Correction {
        by: By::Autopilot,
        iron: compass.iron,
        score: score(&rows, |row| Some((heading_deg(row, row.logged.ut.map(f64::from)), f64::NAN))),
    };
    let mut corrections = vec![of(By::Nobody, Some(Iron::none()))];
    corrections.extend(compass.iron.is_some().then_some(logged));
    corrections.push(of(By::Sphere, fits::sphere(&fields).map(|(iron, _)| iron)));
    corrections.push(of(By::Ellipsoid, fits::ellipsoid(&fields).map(|(iron, _)| iron)));
    let solved = |by, replayed: &Replayed| Correction { by, iron: ours(replayed), score: replayed.score };
    corrections.push(solved(By::Module, &module));
    if options.selected != Selected::All {
        corrections.push(solved(By::ModuleOfAll, &all));
    }
    let sphere = fits::sphere(&fields);
    let radius_ut = sphere.map(|(_, radius_ut)| radius_ut).filter(|_| is_turned(&fields));
    let about = ours(&all).or_else(|| ours(&module)).or(sphere.map(|(iron, _)| iron));
    let change = about.and_then(|about| change::found(&rows, &about));
    let parts = change.as_ref().map_or_else(Vec::new, |change| {
        let [before, after]: [Vec<Row>; 2] =
            [true, false].map(|is| rows.iter().filter(|row| (row.t_s < change.at_s) == is).copied().collect());
        let expected =
            |part: &Vec<Row>| solved_of_all(part).map(|solution| f64::from(solution.quality.expected_rms_deg));
        vec![expected(&before), expected(&after)]
    });
    let every_s = compass.field.median_step_s().unwrap_or(f64::NAN);
    let Compass { number, is_used, .. } = *compass;
    Judged {
        number,
        is_used,
        age,
        rows,
        counted,
        every_s,
        module,
        all,
        without_current_deg,
        corrections,
        radius_ut,
        change,
        parts,
    }
}

/// Whether the field was turned far enough that a sphere through it says how strong it is: by a quarter of it along some axis.
/// Of an aircraft at rest it says how much the sensor noises.
fn is_turned(fields: &[Vector3<f64>]) -> bool {
    const PART: f64 = 0.25;
    let mean = fields.iter().sum::<Vector3<f64>>() / fields.len().max(1) as f64;
    (0..3).any(|axis| {
        let along = || fields.iter().map(|field| field[axis]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min) > PART * mean.norm()
    })
}

/// What the module would have made of the rows if it had not been told the current.
fn without_current_deg(rows: &[Row], flight: &Flight, module: &Replayed, options: &Options) -> Option<f64> {
    let is_used = module.solution.as_ref().is_some_and(|solution| solution.calibration.current.is_used());
    if !is_used {
        return None;
    }
    let untold: Vec<Row> = rows.iter().map(|row| Row { current_a: None, ..*row }).collect();
    Some(replay_with(&untold, Some(flight), options).score?.rms_deg)
}

/// What the module solved, as a correction.
fn ours(replayed: &Replayed) -> Option<Iron> {
    let calibration = replayed.solution.as_ref()?.calibration;
    let matrix = calibration.w_matrix().map(f64::from);
    let by_current_ut = Vector3::from(calibration.current.ut_per_a).map(f64::from);
    Some(Iron { matrix, centre_ut: calibration.b_vector_ut().map(f64::from), by_current_ut })
}

/// How good headings by a correction are.
#[must_use]
pub fn scored(rows: &[Row], iron: &Iron) -> Option<Score> {
    score(rows, |row| Some((heading_deg(row, row.corrected(iron)), f64::NAN)))
}

fn heading_deg(row: &Row, corrected: Vector3<f64>) -> f64 {
    let field: Field<Body> = Field::new(corrected.map(|axis| axis as f32));
    f64::from(row.attitude.level(field).heading_rad().to_degrees())
}

/// The middle one; not a number of nothing.
pub(super) fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Where the middle of the flight was.
fn place(flight: &Flight) -> Option<Place> {
    let rows = flight.gps.rows();
    let gps = Gps::from_columns(rows.get(rows.len() / 2)?.of);
    Place::new(gps.latitude_deg, gps.longitude_deg, gps.height_m)
}

/// The Earth's field at the middle of the flight, and whether the model holds on its day: on another it is that of the
/// model's first day.
fn earth(flight: &Flight) -> Option<(EarthField, bool)> {
    /// 2025-01-01, when the model begins.
    const MODEL_BEGINS_UNIX_S: u64 = 1_735_689_600;
    let place = place(flight)?;
    let now = flight.day.and_then(|day| EarthField::of(place, day)).map(|field| (field, true));
    now.or_else(|| EarthField::of(place, Day::from_unix_s(MODEL_BEGINS_UNIX_S)?).map(|field| (field, false)))
}

impl Judged {
    /// Why the module would have refused, in its words.
    #[must_use]
    pub fn refusal(&self) -> Option<Refusal> {
        refusal(&self.module)
    }
}

/// The refusal as the module would tell it: with what was wrong with the flight, else with what would help.
#[must_use]
pub fn refusal(replayed: &Replayed) -> Option<Refusal> {
    let refusal = match replayed.accepted.as_ref().err()? {
        Refused::Solve(error) => Refusal::Solve(*error),
        Refused::Rejected(rejection) => Refusal::Rejected(*rejection),
    };
    let advice = || replayed.solution.as_ref()?.advice.filter(Advice::gains);
    let missing = || advice().map(|advice| Lack::Missing(advice.manoeuvre));
    Some(refusal.because(replayed.lack.or_else(missing)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Format;

    /// A flight from the equator to 60 N.
    fn northwards(day: Option<Day>) -> Flight {
        let mut flight = Flight::new(Format::Csv);
        flight.day = day;
        for i in 0..7_u8 {
            flight.gps.push(f64::from(i), [10.0 * f32::from(i), 11.3, 500.0, 0.0, 0.0, f32::NAN]);
        }
        flight
    }

    /// The field is that of the middle of the flight; without a day, or on one that the model does not reach, that of its first.
    #[test]
    fn the_earths_field_is_that_of_the_middle_of_the_flight() {
        let day = |unix_s: u64| Day::from_unix_s(unix_s).unwrap();
        let place = Place::new(30.0, 11.3, 500.0).unwrap();
        let (of_2026, first) = (day(1_767_484_800), day(1_735_689_600));
        for (on, expected, is_valid) in
            [(Some(of_2026), of_2026, true), (None, first, false), (Some(day(1_640_995_200)), first, false)]
        {
            let expected = EarthField::of(place, expected).unwrap();
            let (found, is) = earth(&northwards(on)).unwrap();
            assert_eq!(is, is_valid);
            let numbers = |field: EarthField| [field.total_ut, field.inclination_deg].map(f32::to_bits);
            assert_eq!(numbers(found), numbers(expected));
        }
        assert!(earth(&Flight::new(Format::Csv)).is_none());
    }
}
