//! How accurate the methods are, against the bound of what is possible.
//!
//! Random airframes, places, flights and instruments ([`trial`]); for each, many draws of the noise, solved by every
//! method. What counts is the RMS heading error over that of the Cramer-Rao bound ([`bound`]), and whether the sigma of
//! a heading is true.
//!
//! That is of turns alone, all samples of which are solved. Of whole flights ([`flights`]) of an aircraft ([`flight`]) the
//! module keeps some ([`collected`]), and the bound is that of the best it could have kept ([`greedy`]).

pub mod bound;
pub mod collected;
pub mod flight;
pub mod flights;
pub mod greedy;
pub mod trial;

use autoswing::acceptance::{self, Grounds, Incumbent, Policy};
use autoswing::calibration::{Consider, Method, Orientation, Prior, Samples, Solution, SolveError, Solver};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;

use trial::{Faults, Ranges, Recorded, Trial};

use crate::score::within_percent;

/// What to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Airframes drawn.
    pub airframes: u64,
    /// Draws of the noise for each. The ratio to the bound scatters by about `0.3 / sqrt(draws)` of itself by chance.
    pub draws: u64,
    /// Seed of the first airframe.
    pub seed: u64,
}

/// How a method did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Result {
    /// Its name.
    pub method: &'static str,
    /// Solves that ended with coefficients, percent.
    pub converged_percent: f64,
    /// Solves that an uncalibrated module would accept, percent.
    pub accepted_percent: f64,
    /// Accepted ones with a true RMS error of more than three times the expected one.
    pub wrong: u32,
    /// RMS heading error, median over the airframes, degrees.
    pub rms_median_deg: f64,
    /// RMS heading error over the bound's, median over the airframes.
    pub ratio_median: f64,
    /// RMS heading error over the bound's: the value that a tenth of the airframes exceed.
    pub ratio_worst_decile: f64,
}

/// How many errors lie within one and two sigma of their heading, percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Within one; 68.3 would be perfect.
    pub one_sigma_percent: f64,
    /// Within two; 95.4 would be perfect.
    pub two_sigma_percent: f64,
    /// Headings looked at.
    pub headings: usize,
}

/// What came out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// The bound, median over the airframes, degrees.
    pub bound_median_deg: f64,
    /// By method.
    pub methods: Vec<Result>,
    /// Of an attitude source with noise alone, which the solver was told.
    pub coverage: Coverage,
    /// Of a source with the constant errors that the module allows for ([`Consider::DEFAULT`]).
    pub coverage_with_faults: Coverage,
}

/// The methods compared.
const METHODS: [Method; 3] = [Method::MaximumLikelihood, Method::TwoPlane, Method::FourEllipse];

/// Of every so many draws, the sigmas are looked at, too.
const COVERAGE_EVERY: u64 = 5;

/// Headings at which they are looked at.
const HEADINGS: usize = 16;

/// Runs the plan; `tick` is called once an airframe, from any thread.
#[must_use]
pub fn run(plan: Plan, tick: &(dyn Fn() + Sync)) -> Outcome {
    let trials: Vec<Tried> = (plan.seed..plan.seed + plan.airframes)
        .into_par_iter()
        .filter_map(|seed| {
            let tried = Tried::of(&Trial::draw(&Ranges::HARSH, seed), plan.draws);
            tick();
            tried
        })
        .collect();
    let all_of = |errors: fn(&Tried) -> &Vec<f64>| trials.iter().flat_map(errors).copied().collect::<Vec<f64>>();
    Outcome {
        bound_median_deg: quantile(trials.iter().map(|t| t.bound_deg), 0.5),
        methods: METHODS.iter().enumerate().map(|(i, &method)| summary(&trials, i, method)).collect(),
        coverage: coverage(&all_of(|t| &t.normalised)),
        coverage_with_faults: coverage(&all_of(|t| &t.normalised_with_faults)),
    }
}

/// One airframe.
struct Tried {
    bound_deg: f64,
    methods: [Counts; METHODS.len()],
    /// Errors over their sigmas.
    normalised: Vec<f64>,
    normalised_with_faults: Vec<f64>,
}

/// Errors over sigmas of headings after a flight with an attitude source that has what is considered, and nothing else.
fn use_headings(trial: &Trial, draw: u64, consider: Consider) -> Vec<f64> {
    let (recorded, mut used) = trial.record(draw, Faults::of(consider));
    let Ok(solution) = solve(Method::MaximumLikelihood, recorded.samples(), consider) else { return Vec::new() };
    (0..HEADINGS).filter_map(|_| trial.error_over_sigma(&solution, &mut used)).collect()
}

#[derive(Clone, Copy, Default)]
struct Counts {
    solved: u32,
    refused: u32,
    accepted: u32,
    wrong: u32,
    /// Sum of the mean squares of the solved ones, square degrees.
    squares: f64,
}

impl Counts {
    fn rms_deg(&self) -> f64 {
        (self.squares / f64::from(self.solved)).sqrt()
    }
}

impl Tried {
    /// `None` when the flight does not determine the coefficients at all.
    fn of(trial: &Trial, draws: u64) -> Option<Self> {
        let mut tried = Self {
            bound_deg: bound::rms_deg(trial)?,
            methods: [Counts::default(); METHODS.len()],
            normalised: Vec::new(),
            normalised_with_faults: Vec::new(),
        };
        for draw in 0..draws {
            let (recorded, _) = trial.record(draw, Faults::NONE);
            for (counts, method) in tried.methods.iter_mut().zip(METHODS) {
                counts.add(trial, &recorded, solve(method, recorded.samples(), Consider::DEFAULT).ok().as_ref());
            }
            if draw % COVERAGE_EVERY == 0 {
                tried.normalised.extend(use_headings(trial, draw, Consider::NOTHING));
                tried.normalised_with_faults.extend(use_headings(trial, draw, Consider::DEFAULT));
            }
        }
        Some(tried)
    }
}

impl Counts {
    fn add(&mut self, trial: &Trial, recorded: &Recorded, solution: Option<&Solution>) {
        let Some(solution) = solution else {
            self.refused += 1;
            return;
        };
        let errors_deg = trial.errors_deg(&solution.calibration);
        let square = errors_deg.iter().map(|e| e * e).sum::<f64>() / errors_deg.len() as f64;
        let accepted = is_accepted(recorded, solution);
        self.solved += 1;
        self.squares += square;
        self.accepted += u32::from(accepted);
        self.wrong += u32::from(accepted && square.sqrt() > 3.0 * f64::from(solution.quality.expected_rms_deg));
    }
}

/// Whether an uncalibrated module would take it.
fn is_accepted(recorded: &Recorded, solution: &Solution) -> bool {
    let grounds = Grounds { fitted: recorded.samples(), held_back: recorded.held_back(), knows_attitude: true };
    acceptance::judge(&Policy::DEFAULT, solution, grounds, &Incumbent::none(Orientation::NONE)).is_ok()
}

fn solve(method: Method, samples: Samples<'_>, consider: Consider) -> std::result::Result<Solution, SolveError> {
    // The samples are single readings here, as the headings are.
    Solver::with_consider(method, samples, &Prior::default(), consider)?.run(samples)
}

fn summary(trials: &[Tried], index: usize, method: Method) -> Result {
    let each = || trials.iter().map(|t| (t, &t.methods[index]));
    let sum = |of: fn(&Counts) -> u32| each().map(|(_, counts)| of(counts)).sum::<u32>();
    let (solved, refused) = (sum(|c| c.solved), sum(|c| c.refused));
    let percent = |part: u32| 100.0 * f64::from(part) / f64::from((solved + refused).max(1));
    let solved_ones = || each().filter(|(_, counts)| counts.solved > 0);
    let ratios = || solved_ones().map(|(trial, counts)| counts.rms_deg() / trial.bound_deg);
    Result {
        method: method.name(),
        converged_percent: percent(solved),
        accepted_percent: percent(sum(|c| c.accepted)),
        wrong: sum(|c| c.wrong),
        rms_median_deg: quantile(solved_ones().map(|(_, counts)| counts.rms_deg()), 0.5),
        ratio_median: quantile(ratios(), 0.5),
        ratio_worst_decile: quantile(ratios(), 0.9),
    }
}

fn coverage(normalised: &[f64]) -> Coverage {
    let [one_sigma_percent, two_sigma_percent] = within_percent(normalised);
    Coverage { one_sigma_percent, two_sigma_percent, headings: normalised.len() }
}

/// The value that a part of the values does not exceed; not a number without values.
fn quantile(values: impl Iterator<Item = f64>, part: f64) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let index = (sorted.len().saturating_sub(1) as f64 * part).round() as usize;
    sorted.get(index).copied().unwrap_or(f64::NAN)
}
