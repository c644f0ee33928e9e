//! A recorded flight through the module's own instrument, collection, solver and acceptance.

pub mod age;
pub mod change;
pub mod course;
mod dead;
mod device;
pub mod fits;
pub mod judge;
mod lost;
pub mod parameters;
mod reference;
mod rows;
pub mod told;

pub use reference::Reference;
pub use rows::{Counted, Row, Told, rows, told_between};

use crate::log::Flight;

use autoswing::acceptance::{self, Grounds, Incumbent, Policy, Rejection};
use autoswing::attitude::{self, Motion, Report, Source};
use autoswing::calibration::ladder::{self, Procedure, Selection};
use autoswing::calibration::{
    Calibration, Method, Orientation, Prior, Rates, Sample, Samples, Solution, SolveError, solve,
};
use autoswing::collection::dataset::FIT_CAPACITY;
use autoswing::collection::{self, Collector, Kept, Lack};
use autoswing::earth::{Day, EarthField, Place};
use autoswing::frames::{Attitude, Field, Level};
use autoswing::heading::{self, Heading, NoHeading};
use autoswing::instrument::{Config, Correction, Estimate, Instrument};
use autoswing::magnetometer::Reading;
use autoswing::time::{Timestamp, WrappingMillis};

use crate::score::{within_percent, wrap_180};

/// Which rows are fitted to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selected {
    /// All usable ones, evenly thinned to what the device holds.
    All,
    /// What the device's turn detector would have kept.
    Turns,
    /// What the device would have kept of whatever was flown, until it ends by itself.
    Flight,
}

/// How to replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Which rows are fitted to.
    pub selected: Selected,
    /// Inclination of the Earth field there, degrees, where a person told it.
    pub inclination_deg: Option<f64>,
    /// Where and when it was flown: the field model tells the inclination where no person does. Unlike a person it gives way
    /// to samples that contradict it.
    pub here: Option<(Place, Day)>,
    /// Rows from this time on are not fitted to, seconds.
    pub fit_until_s: Option<f64>,
}

impl Options {
    /// These rows, of which nothing else is told.
    #[must_use]
    pub const fn of(selected: Selected) -> Self {
        Self { selected, inclination_deg: None, here: None, fit_until_s: None }
    }

    /// What is told of the inclination, radians: by a person, or else by the field model.
    fn inclination_rad(&self) -> Option<f32> {
        let by_model = || {
            let (place, day) = self.here?;
            Some(EarthField::of(place, day)?.inclination_deg)
        };
        self.inclination_deg.map(|deg| deg as f32).or_else(by_model).map(f32::to_radians)
    }
}

/// Why the flight gave no calibration that the module would have taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// The solver's reason.
    Solve(SolveError),
    /// Solved, but an uncalibrated module would not have taken it.
    Rejected(Rejection),
}

/// A heading of every row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Seconds.
    pub t_s: f64,
    /// Magnetic heading, degrees.
    pub heading_deg: f64,
    /// Its standard deviation, degrees.
    pub sigma_deg: f64,
    /// The smooth heading and its standard deviation, degrees, where there is one.
    pub smooth_deg: Option<[f64; 2]>,
    /// Whether the module would have sent it, or why not.
    pub status: Result<(), NoHeading>,
}

impl Shown {
    /// What an estimate shows, with the status of another: the heading is shown in any field.
    fn of(t_s: f64, estimate: &Estimate, status: Result<(), NoHeading>) -> Self {
        let degrees = |heading: Heading| [heading.magnetic_deg(), heading.sigma_deg()].map(f64::from);
        let [heading_deg, sigma_deg] = estimate.heading.map_or([f64::NAN; 2], degrees);
        Self { t_s, heading_deg, sigma_deg, smooth_deg: estimate.smooth.map(degrees), status }
    }

    /// The heading that the module would send of itself, and its standard deviation: the smooth one where there is one.
    fn sent_deg(&self) -> [f64; 2] {
        self.smooth_deg.unwrap_or([self.heading_deg, self.sigma_deg])
    }
}

/// Heading against the reference over usable rows, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// RMS after removing the mean.
    pub rms_deg: f64,
    /// The mean, which holds the variation where the reference counts from true north.
    pub mean_deg: f64,
    /// Rows.
    pub rows: usize,
    /// Percent of the demeaned errors within one and two sigma.
    pub within_percent: [f64; 2],
}

/// A replayed flight.
#[derive(Clone, Debug)]
pub struct Replayed {
    /// What was solved.
    pub solution: Option<Solution>,
    /// Whether the module would have taken it.
    pub accepted: Result<(), Refused>,
    /// What was wrong with the flight, where turns were selected and that can be said.
    pub lack: Option<Lack>,
    /// Samples that were fitted to.
    pub samples: usize,
    /// When they were taken, seconds after the first row, in any order.
    pub fitted_s: Vec<f64>,
    /// When the collection of whatever was flown ended by itself, seconds after the first row; none if it did not.
    pub ended_s: Option<f64>,
    /// A heading for each row; none without a solution.
    pub shown: Vec<Shown>,
    /// Against the reference, where there is one.
    pub score: Option<Score>,
    /// The same of the smooth heading, or the raw one where there is no smooth one, as the module sends it.
    pub smooth: Option<Score>,
    /// The same of the field as it was measured.
    pub uncorrected: Option<Score>,
}

/// Replays a flight of which nothing is known but its rows. They are in the order of time.
#[must_use]
pub fn replay(rows: &[Row], options: &Options) -> Replayed {
    replay_with(rows, None, options)
}

/// Replays rows of a flight that tells the attitude between them, too.
#[must_use]
pub fn replay_with(rows: &[Row], flight: Option<&Flight>, options: &Options) -> Replayed {
    let config = config_of(rows);
    let known = Known {
        prior: Prior {
            mount: Orientation::NONE,
            inclination_rad: options.inclination_rad(),
            readings_per_sample: config.readings_per_sample(),
        },
        is_by_person: options.inclination_deg.is_some(),
    };
    let usable = fitted(rows, options, config);
    let mut kept = Kept::EMPTY;
    let ((result, fitted_s, lack), ended) = match options.selected {
        Selected::All => (from_all(&usable, &known), None),
        Selected::Turns => (from_turns(&usable, &known), None),
        Selected::Flight => {
            let (compass, ended) = device::collect(&usable, options, &mut kept);
            (from_collected(compass.collected(), &known), ended)
        }
    };
    let ended_s = ended.and_then(|samples| usable[..samples].last()).map(taken_s);
    let (solution, accepted) = match result {
        Ok((solution, accepted)) => (Some(solution), accepted),
        Err(error) => (None, Err(Refused::Solve(error))),
    };
    let uncalibrated = Calibration::uncalibrated(Orientation::NONE);
    let uncorrected = score(rows, |row| Some((heading_deg(&uncalibrated, row), f64::NAN)));
    let shown = solution.as_ref().map_or_else(Vec::new, |solution| show(rows, flight, solution, config));
    let of = |heading: fn(&Shown) -> [f64; 2]| {
        let mut each = shown.iter().map(heading);
        score(rows, |_| each.next().map(|[heading_deg, sigma_deg]| (heading_deg, sigma_deg)))
    };
    let (raw, smooth) = (of(|shown| [shown.heading_deg, shown.sigma_deg]), of(Shown::sent_deg));
    let samples = fitted_s.len();
    Replayed { solution, accepted, lack, samples, fitted_s, ended_s, shown, score: raw, smooth, uncorrected }
}

/// The watch is made for ten samples a second, as the module takes them. What it makes of rows with more time between
/// them, microseconds, is no longer what it would make of the flight: of one row a second it believes that iron moves, and
/// errs by degrees. Readings of 11 to 12.5 a second are rows in pairs, up to 0.18 s apart.
const MAX_WATCHED_US: u32 = 190_000;

/// Whether rows that come so often, seconds, are watched as the module watches its own.
#[must_use]
pub fn is_watched(every_s: f64) -> bool {
    every_s * 1e6 <= f64::from(MAX_WATCHED_US)
}

/// An instrument for rows that come as often as these, their attitude of the same instants as their field.
fn config_of(rows: &[Row]) -> Config {
    let median_s = rows::median_step_s(rows).unwrap_or(0.1);
    let attitude = attitude::Config { latency_us: 0, ..attitude::Config::DEFAULT };
    Config { attitude, ..Config::new((median_s * 1e6).round() as u32) }
}

fn instant(t_s: f64, start_s: f64) -> Timestamp {
    Timestamp::from_us(((t_s - start_s) * 1e6).round() as u64)
}

/// What the instrument makes of a row, its instant counted from a start.
fn estimate(instrument: &mut Instrument, row: &Row, start_s: f64) -> Estimate {
    let at = instant(row.t_s, start_s);
    instrument.on_attitude(at, report(row.attitude, row.rates_rad_s));
    if let Some(amperes) = row.current_a {
        instrument.on_current(at, amperes);
    }
    instrument.on_reading(at, Reading { field: row.field, saturated: false, overrun: false })
}

/// What the attitude source would have sent. A recording has no clock but its own: reports are stamped by their arrival.
fn report(attitude: Attitude, rates_rad_s: Option<[f32; 3]>) -> Report {
    let (sender_time, rates_rad_s) = (WrappingMillis::default(), rates_rad_s.unwrap_or_default());
    Report { source: Source::default(), sender_time, attitude, rates_rad_s }
}

/// The samples that may be fitted to.
fn fitted(rows: &[Row], options: &Options, config: Config) -> Vec<Sample> {
    let usable = rows.iter().filter(|row| row.usable && options.fit_until_s.is_none_or(|until_s| row.t_s < until_s));
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let mut instrument = Instrument::new(config);
    usable
        .flat_map(|row| {
            estimate(&mut instrument, row, start_s);
            std::iter::from_fn(|| instrument.next_sample()).collect::<Vec<_>>()
        })
        .collect()
}

type Solved = Result<(Solution, Result<(), Refused>), SolveError>;

/// What was solved, of samples of which instants, and what was wrong with the flight, where that can be said.
type FromSamples = (Solved, Vec<f64>, Option<Lack>);

/// What is known before the samples are looked at.
struct Known {
    prior: Prior,
    /// Whether a person told the inclination.
    is_by_person: bool,
}

impl Known {
    /// As the module does it: samples that contradict an inclination that no person told are solved without.
    fn solve(&self, method: Method, samples: Samples<'_>) -> Result<Solution, SolveError> {
        match solve(method, samples, &self.prior) {
            Err(SolveError::InclinationContradicted { .. }) if !self.is_by_person => {
                solve(Method::MaximumLikelihood, samples, &Prior { inclination_rad: None, ..self.prior })
            }
            end => end,
        }
    }
}

/// What all usable rows give; none if nothing.
fn solved_of_all(rows: &[Row]) -> Option<Solution> {
    let config = config_of(rows);
    let prior = Prior { readings_per_sample: config.readings_per_sample(), ..Prior::default() };
    let samples = fitted(rows, &Options::of(Selected::All), config);
    let (solved, _, _) = from_all(&samples, &Known { prior, is_by_person: false });
    solved.ok().map(|(solution, _)| solution)
}

/// Through the device's detector of turns, too.
fn from_turns(samples: &[Sample], known: &Known) -> FromSamples {
    let mut kept = Kept::EMPTY;
    let mut collector = Collector::new(&mut kept);
    collector.begin(Procedure::Turns);
    for &sample in samples {
        collector.push(sample);
    }
    from_collected(&collector, known)
}

/// Through the device's ladder and verification.
fn from_collected(collector: &Collector<'_>, known: &Known) -> FromSamples {
    let procedure = collector.procedure();
    let selection = Selection::of(collector.fit(), procedure);
    let fit = selection.from(collector.fit());
    let solved = ladder::choose(collector.fit(), procedure)
        .and_then(|method| known.solve(method, fit))
        .map(|solution| (solution, judged(&solution, fit, selection.from(collector.held_back()))));
    (solved, fit.all().map(taken_s).collect(), collector.lack())
}

/// Every so many samples one is fitted to, and the ones half-way between are held back.
fn from_all(samples: &[Sample], known: &Known) -> FromSamples {
    let number = samples.len().min(2 * FIT_CAPACITY);
    let thinned = |phase: f64| -> Vec<Sample> {
        (0..number)
            .filter_map(|i| samples.get(((i as f64 + phase) * samples.len() as f64 / number as f64) as usize))
            .copied()
            .collect()
    };
    let (fit, held_back) = (Split::of(&thinned(0.0)), Split::of(&thinned(0.5)));
    let solved = known
        .solve(Method::MaximumLikelihood, fit.samples())
        .map(|solution| (solution, judged(&solution, fit.samples(), held_back.samples())));
    (solved, fit.samples().all().map(taken_s).collect(), None)
}

/// When a sample was taken, seconds after the first row.
fn taken_s(sample: &Sample) -> f64 {
    f64::from(sample.time.count()) / 1e3
}

/// Samples by the side they bank to.
struct Split {
    left: Vec<Sample>,
    right: Vec<Sample>,
    level: Vec<Sample>,
}

impl Split {
    fn of(samples: &[Sample]) -> Self {
        let limit_rad = collection::Config::DEFAULT.level_roll_rad;
        let of = |keep: &dyn Fn(f32) -> bool| -> Vec<Sample> {
            samples.iter().filter(|s| keep(s.attitude.roll_rad)).copied().collect()
        };
        Self {
            left: of(&|roll_rad| roll_rad < -limit_rad),
            right: of(&|roll_rad| roll_rad > limit_rad),
            level: of(&|roll_rad| roll_rad.abs() <= limit_rad),
        }
    }

    fn samples(&self) -> Samples<'_> {
        Samples { left: &self.left, right: &self.right, level: &self.level, ..Samples::default() }
    }
}

/// Whether an uncalibrated module would take it.
fn judged(solution: &Solution, fitted: Samples<'_>, held_back: Samples<'_>) -> Result<(), Refused> {
    let none = Incumbent::none(Orientation::NONE);
    let grounds = Grounds { fitted, held_back, knows_attitude: true };
    acceptance::judge(&Policy::DEFAULT, solution, grounds, &none).map(|_| ()).map_err(Refused::Rejected)
}

/// The field of a row as a calibration corrects and levels it.
#[must_use]
pub fn levelled(calibration: &Calibration, row: &Row) -> Field<Level> {
    let Motion { roll_rad_s, pitch_rad_s, heading_rad_s } =
        Motion::of(&report(row.attitude, row.rates_rad_s)).unwrap_or_default();
    let rates = Rates::from_rad_s([roll_rad_s, pitch_rad_s, heading_rad_s]);
    let sample = Sample { field: row.field, attitude: row.attitude, rates, time: WrappingMillis::default() };
    calibration.level(&sample)
}

fn heading_deg(calibration: &Calibration, row: &Row) -> f64 {
    f64::from(levelled(calibration, row).heading_rad().to_degrees())
}

/// What the module would have shown for every row.
fn show(rows: &[Row], flight: Option<&Flight>, solution: &Solution, config: Config) -> Vec<Shown> {
    // Rates of which some are lost are told to nobody: they are no turn that was flown.
    let is_whole = flight.is_none_or(|flight| lost::of_the_rates(flight).is_none());
    let rates_of = |rates_rad_s: Option<[f32; 3]>| rates_rad_s.filter(|_| is_whole);
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let calibration = Some((solution.calibration, solution.uncertainty));
    let [mut device, mut any] = [config.heading, heading::Config::ANY_FIELD].map(|heading| {
        let mut instrument = Instrument::new(Config { heading, ..config });
        instrument.correct_with(Correction { calibration, ..Correction::NONE });
        instrument
    });
    let mut last_s = start_s;
    rows.iter()
        .map(|row| {
            let row = &Row { rates_rad_s: rates_of(row.rates_rad_s), ..*row };
            let from_s = std::mem::replace(&mut last_s, row.t_s);
            for told in flight.map_or_else(Vec::new, |flight| told_between(flight, from_s, row.t_s)) {
                let report = report(told.attitude, rates_of(told.rates_rad_s));
                for instrument in [&mut device, &mut any] {
                    instrument.on_attitude(instant(told.t_s, start_s), report);
                }
            }
            // The heading is shown in any field; whether it would have been sent is its status.
            let [sent, shown] = [&mut device, &mut any].map(|instrument| {
                let estimate = estimate(instrument, row, start_s);
                while instrument.next_sample().is_some() {}
                if is_whole && config.reading_period_us <= MAX_WATCHED_US {
                    instrument.watch();
                }
                estimate
            });
            Shown::of(row.t_s, &shown, sent.heading.map(|_| ()))
        })
        .collect()
}

/// Errors of usable rows with a reference; `heading` is asked for every row in turn.
fn score(rows: &[Row], mut heading: impl FnMut(&Row) -> Option<(f64, f64)>) -> Option<Score> {
    let errors: Vec<(f64, f64)> = rows
        .iter()
        .filter_map(|row| {
            // Before the first report, and in a gap, there is none.
            let (heading_deg, sigma_deg) = heading(row).filter(|(heading_deg, _)| heading_deg.is_finite())?;
            let reference_deg = row.reference_deg.filter(|_| row.usable)?;
            Some((wrap_180(heading_deg - reference_deg), sigma_deg))
        })
        .collect();
    if errors.is_empty() {
        return None;
    }
    let number = errors.len() as f64;
    // The mean on the circle, so that errors about 180 deg do not cancel.
    let (sin, cos) = errors.iter().fold((0.0, 0.0), |(sin, cos), (error, _)| {
        let (s, c) = error.to_radians().sin_cos();
        (sin + s, cos + c)
    });
    let mean_deg = sin.atan2(cos).to_degrees();
    let rest = |error: f64| wrap_180(error - mean_deg);
    let normalised: Vec<f64> = errors.iter().map(|(error, sigma_deg)| rest(*error) / sigma_deg).collect();
    Some(Score {
        rms_deg: (errors.iter().map(|(error, _)| rest(*error).powi(2)).sum::<f64>() / number).sqrt(),
        mean_deg,
        rows: errors.len(),
        within_percent: within_percent(&normalised),
    })
}

#[cfg(test)]
mod tests;
