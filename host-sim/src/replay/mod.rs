//! Replays a recorded flight through the module's instrument, collection, solver and acceptance test.

pub mod baseline_fits;
mod data_loss;
mod device_collection;
pub mod evaluation;
pub mod field_latency;
mod frozen_field;
pub mod gps_course;
pub mod hard_iron_step;
pub mod note;
pub mod parameter_export;
mod reference;
mod rows;
pub mod verdict;

pub use reference::ReferenceHeading;
pub use rows::{AttitudeSample, ReplayRow, RowCounts, attitudes_between, build_rows};

use crate::log::Flight;

use autoswing::acceptance::Rejection;
use autoswing::attitude::{self, AttitudeReport, EulerRates, SenderId};
use autoswing::calibration::method_selection::{self, Procedure, SelectedParts};
use autoswing::calibration::{
    Advice, Calibration, Current, Method, Orientation, Part, Prior, Rates, Sample, Samples, Solution, SolveError, solve,
};
use autoswing::collection::FIT_CAPACITY;
use autoswing::collection::{self, CollectionProblem, Collector, RetainedSamples};
use autoswing::earth::{Date, EarthField, Position};
use autoswing::frames::{Attitude, Field, Level};
use autoswing::heading::{self, Heading, NoHeading};
use autoswing::instrument::{Correction, Estimate, Instrument, InstrumentConfig};
use autoswing::messages::Refusal;
use autoswing::reading::Reading;
use autoswing::time::{Timestamp, WrappingMillis};

use crate::numbers::mean_angle_deg;
use crate::score::{accepted_by_uncalibrated, within_percent, wrap_180};

/// Rows used for the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowSelection {
    /// All usable rows, evenly thinned to the device's capacity.
    All,
    /// Samples kept by the device's turn procedure.
    Turns,
    /// Samples kept by the device in any flight, until it ends the collection.
    Flight,
}

/// Options of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplayOptions {
    /// Rows used for the fit.
    pub selected: RowSelection,
    /// Configured inclination of the Earth field, degrees.
    pub inclination_deg: Option<f64>,
    /// Place and day for the field model, used if no inclination is configured and dropped if the samples contradict
    /// it.
    pub place_and_day: Option<(Position, Date)>,
    /// Rows from this flight time on are not fitted, seconds.
    pub fit_until_s: Option<f64>,
}

impl ReplayOptions {
    /// Options with a row selection and no prior information.
    #[must_use]
    pub const fn with_selection(selected: RowSelection) -> Self {
        Self { selected, inclination_deg: None, place_and_day: None, fit_until_s: None }
    }

    /// Configured inclination, else that of the field model, radians.
    fn inclination_rad(&self) -> Option<f32> {
        let by_model = || {
            let (place, day) = self.place_and_day?;
            Some(EarthField::from_model(place, day)?.inclination_deg)
        };
        self.inclination_deg.map(|deg| deg as f32).or_else(by_model).map(f32::to_radians)
    }
}

/// Reason why the module would not have calibrated.
#[derive(Clone, Debug, PartialEq)]
pub enum ReplayRefusal {
    /// The solver failed.
    Solve(SolveError),
    /// An uncalibrated module would reject the solution.
    Rejected(Rejection),
}

/// Heading of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingRow {
    /// Flight time, seconds.
    pub t_s: f64,
    /// Magnetic heading, degrees.
    pub heading_deg: f64,
    /// Standard deviation of the heading, degrees.
    pub sigma_deg: f64,
    /// Smoothed heading and its standard deviation, degrees, if available.
    pub smooth_deg: Option<[f64; 2]>,
    /// Whether the module would have sent the heading, or why not.
    pub status: Result<(), NoHeading>,
}

impl HeadingRow {
    /// Combines a heading estimated at any field strength with the module's status.
    fn from_estimate(t_s: f64, estimate: &Estimate, status: Result<(), NoHeading>) -> Self {
        let degrees = |heading: Heading| [heading.magnetic_deg(), heading.sigma_deg()].map(f64::from);
        let [heading_deg, sigma_deg] = estimate.heading.map_or([f64::NAN; 2], degrees);
        Self { t_s, heading_deg, sigma_deg, smooth_deg: estimate.smoothed_heading.map(degrees), status }
    }

    /// Heading and standard deviation sent by the module, degrees.
    fn sent_deg(&self) -> [f64; 2] {
        self.smooth_deg.unwrap_or([self.heading_deg, self.sigma_deg])
    }
}

/// Heading error over usable rows with a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingScore {
    /// RMS after removing the mean, degrees.
    pub rms_deg: f64,
    /// Mean, degrees; includes the declination if the reference is true.
    pub mean_deg: f64,
    /// Number of rows.
    pub rows: usize,
    /// Percentage of demeaned errors within one and two standard deviations.
    pub within_percent: [f64; 2],
}

/// Result of a replay.
#[derive(Clone, Debug)]
pub struct ReplayResult {
    /// The solution, if any.
    pub solution: Option<Solution>,
    /// Whether the module would have accepted the solution.
    pub accepted: Result<(), ReplayRefusal>,
    /// What the flight lacked, if the collector reports it.
    pub missing: Option<CollectionProblem>,
    /// Number of samples fitted.
    pub samples: usize,
    /// Times of the fitted samples, seconds after the first row, unordered.
    pub fitted_s: Vec<f64>,
    /// Time of the automatic end, seconds after the first row.
    pub ended_s: Option<f64>,
    /// Headings, one for each row; empty without a solution.
    pub headings: Vec<HeadingRow>,
    /// Score of the heading, with a reference.
    pub score: Option<HeadingScore>,
    /// Score of the heading sent, smoothed if available.
    pub smoothed_score: Option<HeadingScore>,
}

impl ReplayResult {
    /// The module's reason for a refusal, with what the flight lacked or the most useful manoeuvre.
    #[must_use]
    pub fn refusal(&self) -> Option<Refusal> {
        let refusal = match self.accepted.as_ref().err()? {
            ReplayRefusal::Solve(error) => Refusal::Solve(*error),
            ReplayRefusal::Rejected(rejection) => Refusal::Rejected(*rejection),
        };
        let advice = || self.solution.as_ref()?.advice.filter(Advice::is_worthwhile);
        let missing = || advice().map(|advice| CollectionProblem::MissingManoeuvre(advice.manoeuvre));
        Some(refusal.with_cause(self.missing.or_else(missing)))
    }

    /// Expected error of the solution, degrees RMS.
    fn expected_rms_deg(&self) -> Option<f64> {
        self.solution.as_ref().map(|solution| f64::from(solution.quality.expected_rms_deg))
    }
}

/// Replays rows, in order of time, without attitudes between them.
#[must_use]
pub fn replay(rows: &[ReplayRow], options: &ReplayOptions) -> ReplayResult {
    replay_with(rows, None, options)
}

/// Replays rows with the flight's attitudes between them.
#[must_use]
pub fn replay_with(rows: &[ReplayRow], flight: Option<&Flight>, options: &ReplayOptions) -> ReplayResult {
    let config = instrument_config(rows);
    let known = SolverPrior {
        prior: Prior {
            mount: Orientation::NONE,
            inclination_rad: options.inclination_rad(),
            readings_per_sample: config.readings_per_sample(),
        },
        is_inclination_configured: options.inclination_deg.is_some(),
    };
    let usable = fitted(rows, options, config);
    let mut retained = RetainedSamples::EMPTY;
    let ((result, fitted_s, lack), ended) = match options.selected {
        RowSelection::All => (from_all(&usable, &known), None),
        RowSelection::Turns => (from_turns(&usable, &known), None),
        RowSelection::Flight => {
            let (compass, ended) = device_collection::collect_on_device(&usable, options, &mut retained);
            (from_collected(compass.collector(), &known), ended)
        }
    };
    let ended_s = ended.and_then(|samples| usable[..samples].last()).map(sample_time_s);
    let (solution, accepted) = match result {
        Ok((solution, accepted)) => (Some(solution), accepted),
        Err(error) => (None, Err(ReplayRefusal::Solve(error))),
    };
    let shown = solution.as_ref().map_or_else(Vec::new, |solution| compute_headings(rows, flight, solution, config));
    let scored_headings = |heading: fn(&HeadingRow) -> [f64; 2]| {
        let mut each = shown.iter().map(heading);
        score(rows, |_| each.next().map(|[heading_deg, sigma_deg]| (heading_deg, sigma_deg)))
    };
    let (raw, smooth) =
        (scored_headings(|shown| [shown.heading_deg, shown.sigma_deg]), scored_headings(HeadingRow::sent_deg));
    let samples = fitted_s.len();
    ReplayResult {
        solution,
        accepted,
        missing: lack,
        samples,
        fitted_s,
        ended_s,
        headings: shown,
        score: raw,
        smoothed_score: smooth,
    }
}

/// Largest row interval for the monitor, microseconds. At 1 Hz it reports false hard-iron changes and degrades headings
/// by degrees. Pairs of readings at 11 to 12.5 Hz are up to 0.18 s apart.
const MAX_WATCHED_US: u32 = 190_000;

/// Whether the monitor runs at a row interval in seconds.
#[must_use]
pub fn is_monitored(every_s: f64) -> bool {
    every_s * 1e6 <= f64::from(MAX_WATCHED_US)
}

/// Instrument for the interval of these rows; attitude and field are simultaneous.
fn instrument_config(rows: &[ReplayRow]) -> InstrumentConfig {
    let median_s = rows::median_step_s(rows).unwrap_or(0.1);
    let attitude = attitude::AttitudeConfig { latency_us: 0, ..attitude::AttitudeConfig::DEFAULT };
    InstrumentConfig { attitude, ..InstrumentConfig::new((median_s * 1e6).round() as u32) }
}

fn instant(t_s: f64, start_s: f64) -> Timestamp {
    Timestamp::from_us(((t_s - start_s) * 1e6).round() as u64)
}

/// Feeds a row to the instrument; times count from `start_s`.
fn estimate(instrument: &mut Instrument, row: &ReplayRow, start_s: f64) -> Estimate {
    let at = instant(row.t_s, start_s);
    instrument.on_attitude(at, report(row.attitude, row.rates_rad_s));
    if let Some(amperes) = row.current_a {
        instrument.on_current(at, amperes);
    }
    instrument.on_reading(at, Reading { field: row.field, saturated: false, overrun: false })
}

/// Attitude report of a row, dated by arrival.
fn report(attitude: Attitude, rates_rad_s: Option<[f32; 3]>) -> AttitudeReport {
    let (sender_time, rates_rad_s) = (WrappingMillis::default(), rates_rad_s.unwrap_or_default());
    AttitudeReport { sender: SenderId::default(), sender_time, attitude, rates_rad_s }
}

/// Samples of the usable rows before the fit limit.
fn fitted(rows: &[ReplayRow], options: &ReplayOptions, config: InstrumentConfig) -> Vec<Sample> {
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

type SolveResult = Result<(Solution, Result<(), ReplayRefusal>), SolveError>;

/// Solution, times of the fitted samples in seconds, and what the flight lacked.
type FitOutcome = (SolveResult, Vec<f64>, Option<CollectionProblem>);

struct SolverPrior {
    prior: Prior,
    /// Whether the inclination is configured.
    is_inclination_configured: bool,
}

impl SolverPrior {
    /// Solves as the module does, which drops a contradicted modelled inclination.
    fn solve(&self, method: Method, samples: Samples<'_>) -> Result<Solution, SolveError> {
        match solve(method, samples, &self.prior) {
            Err(SolveError::InclinationContradicted { .. }) if !self.is_inclination_configured => {
                solve(Method::MaximumLikelihood, samples, &Prior { inclination_rad: None, ..self.prior })
            }
            end => end,
        }
    }
}

fn solve_all_rows(rows: &[ReplayRow]) -> Option<Solution> {
    let config = instrument_config(rows);
    let prior = Prior { readings_per_sample: config.readings_per_sample(), ..Prior::default() };
    let samples = fitted(rows, &ReplayOptions::with_selection(RowSelection::All), config);
    let (solved, _, _) = from_all(&samples, &SolverPrior { prior, is_inclination_configured: false });
    solved.ok().map(|(solution, _)| solution)
}

fn from_turns(samples: &[Sample], known: &SolverPrior) -> FitOutcome {
    let mut retained = RetainedSamples::EMPTY;
    let mut collector = Collector::new(&mut retained);
    collector.begin(Procedure::Turns);
    for &sample in samples {
        collector.push(sample);
    }
    from_collected(&collector, known)
}

/// Solves with the device's choice of method and its held-back samples.
fn from_collected(collector: &Collector<'_>, known: &SolverPrior) -> FitOutcome {
    let procedure = collector.procedure();
    let selection = SelectedParts::new(collector.fit(), procedure);
    let fit = selection.select(collector.fit());
    let solved = method_selection::select_method(collector.fit(), procedure)
        .and_then(|method| known.solve(method, fit))
        .map(|solution| {
            (
                solution,
                accepted_by_uncalibrated(&solution, fit, selection.select(collector.held_back()))
                    .map_err(ReplayRefusal::Rejected),
            )
        });
    (solved, fit.all().map(sample_time_s).collect(), collector.problem())
}

/// Solves evenly thinned samples; those halfway between are held back.
fn from_all(samples: &[Sample], known: &SolverPrior) -> FitOutcome {
    let number = samples.len().min(2 * FIT_CAPACITY);
    let thinned = |phase: f64| -> Vec<Sample> {
        (0..number)
            .filter_map(|i| samples.get(((i as f64 + phase) * samples.len() as f64 / number as f64) as usize))
            .copied()
            .collect()
    };
    let [fit, held_back] = [0.0, 0.5].map(|phase| assign_parts(&thinned(phase)));
    let [fit, held_back] = [&fit, &held_back].map(|samples| Samples::new(samples));
    let solved = known.solve(Method::MaximumLikelihood, fit).map(|solution| {
        (solution, accepted_by_uncalibrated(&solution, fit, held_back).map_err(ReplayRefusal::Rejected))
    });
    (solved, fit.all().map(sample_time_s).collect(), None)
}

/// Time of a sample, seconds after the first row.
fn sample_time_s(sample: &Sample) -> f64 {
    f64::from(sample.time.as_ms()) / 1e3
}

/// Samples assigned to turns and level flight by their bank.
fn assign_parts(samples: &[Sample]) -> Vec<Sample> {
    let limit_rad = collection::LevelLimits::DEFAULT.level_roll_rad;
    let part_of = |roll_rad: f32| match roll_rad {
        roll_rad if roll_rad < -limit_rad => Some(Part::LEFT),
        roll_rad if roll_rad > limit_rad => Some(Part::RIGHT),
        roll_rad => (roll_rad.abs() <= limit_rad).then_some(Part::LEVEL),
    };
    let assigned = samples.iter().filter_map(|s| Some(Sample { part: part_of(s.attitude.roll_rad)?, ..*s }));
    let mut ordered: Vec<Sample> = assigned.collect();
    ordered.sort_by_key(|sample| sample.part);
    ordered
}

/// Field of a row, calibrated and levelled.
#[must_use]
pub fn level_field(calibration: &Calibration, row: &ReplayRow) -> Field<Level> {
    let EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s } =
        EulerRates::from_report(&report(row.attitude, row.rates_rad_s)).unwrap_or_default();
    let rates = Rates::from_rad_s([roll_rad_s, pitch_rad_s, heading_rad_s]);
    let sample = Sample {
        field: row.field,
        attitude: row.attitude,
        rates,
        time: WrappingMillis::default(),
        current: Current::UNKNOWN,
        part: Part::FREE,
    };
    calibration.corrected_level_field(&sample)
}

fn compute_headings(
    rows: &[ReplayRow],
    flight: Option<&Flight>,
    solution: &Solution,
    config: InstrumentConfig,
) -> Vec<HeadingRow> {
    // Incomplete rates integrate to wrong turns.
    let is_whole = flight.is_none_or(|flight| data_loss::excessive_rate_loss(flight).is_none());
    let rates_of = |rates_rad_s: Option<[f32; 3]>| rates_rad_s.filter(|_| is_whole);
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let calibration = Some((solution.calibration, solution.uncertainty));
    let [mut device, mut any] = [config.heading, heading::HeadingLimits::ANY_FIELD].map(|heading| {
        let mut instrument = Instrument::new(InstrumentConfig { heading, ..config });
        instrument.set_correction(Correction { calibration, ..Correction::NONE });
        instrument
    });
    let mut last_s = start_s;
    rows.iter()
        .map(|row| {
            let row = &ReplayRow { rates_rad_s: rates_of(row.rates_rad_s), ..*row };
            let from_s = std::mem::replace(&mut last_s, row.t_s);
            for logged in flight.map_or_else(Vec::new, |flight| attitudes_between(flight, from_s, row.t_s)) {
                let report = report(logged.attitude, rates_of(logged.rates_rad_s));
                for instrument in [&mut device, &mut any] {
                    instrument.on_attitude(instant(logged.t_s, start_s), report);
                }
            }
            // One instrument accepts any field strength; the other determines the status.
            let [sent, shown] = [&mut device, &mut any].map(|instrument| {
                let estimate = estimate(instrument, row, start_s);
                while instrument.next_sample().is_some() {}
                if is_whole && config.reading_period_us <= MAX_WATCHED_US {
                    instrument.update_monitor();
                }
                estimate
            });
            HeadingRow::from_estimate(row.t_s, &shown, sent.heading.map(|_| ()))
        })
        .collect()
}

/// Score over usable rows with a reference; calls `heading` for every row in order.
fn score(rows: &[ReplayRow], mut heading: impl FnMut(&ReplayRow) -> Option<(f64, f64)>) -> Option<HeadingScore> {
    let errors: Vec<(f64, f64)> = rows
        .iter()
        .filter_map(|row| {
            // No heading before the first report and in gaps.
            let (heading_deg, sigma_deg) = heading(row).filter(|(heading_deg, _)| heading_deg.is_finite())?;
            let reference_deg = row.reference_deg.filter(|_| row.usable)?;
            Some((wrap_180(heading_deg - reference_deg), sigma_deg))
        })
        .collect();
    let number = errors.len() as f64;
    // Circular, so that errors near 180 deg do not cancel.
    let mean_deg = mean_angle_deg(errors.iter().map(|(error, _)| *error))?;
    let rest = |error: f64| wrap_180(error - mean_deg);
    let normalised: Vec<f64> = errors.iter().map(|(error, sigma_deg)| rest(*error) / sigma_deg).collect();
    Some(HeadingScore {
        rms_deg: (errors.iter().map(|(error, _)| rest(*error).powi(2)).sum::<f64>() / number).sqrt(),
        mean_deg,
        rows: errors.len(),
        within_percent: within_percent(&normalised),
    })
}

#[cfg(test)]
mod tests;
