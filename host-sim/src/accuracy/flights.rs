//! How accurate a calibration is after a whole flight, of which the module keeps what it can: against the bound of the best
//! readings that could have been kept.

use std::collections::BTreeSet;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;

use autoswing::calibration::{Consider, Method};

use super::flight::{Flight, Pattern};
use super::trial::{Envelope, Faults, Ranges, Trial};
use super::{COVERAGE_EVERY, Counts, Coverage, HEADINGS, Plan, bound, collected, coverage, greedy, quantile, solve};
use crate::world::aircraft::Kind;

/// What came out of the flights of one pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What flew.
    pub aircraft: &'static str,
    /// What was flown.
    pub pattern: Pattern,
    /// How long.
    pub minutes: f64,
    /// Readings that were kept and solved, median.
    pub readings: f64,
    /// Solves that ended with coefficients, percent.
    pub converged_percent: f64,
    /// Solves that an uncalibrated module would accept, percent.
    pub accepted_percent: f64,
    /// Accepted ones with a true RMS error of more than three times the expected one.
    pub wrong: u32,
    /// RMS heading error, median over the airframes, degrees.
    pub rms_median_deg: f64,
    /// RMS heading error that a tenth of the airframes exceed, degrees.
    pub rms_worst_decile_deg: f64,
    /// RMS heading error over the bound of the readings that were kept, median over the airframes: what the solver adds.
    pub kept_ratio_median: f64,
    /// Bound of the readings that were kept over that of as many, the best of the flight, median over the airframes: what
    /// the choice adds.
    pub choice_ratio_median: f64,
    /// Bound of as many readings, the best of the flight, median over the airframes, degrees.
    pub best_bound_median_deg: f64,
    /// RMS heading error over that bound, median over the airframes.
    pub best_ratio_median: f64,
    /// The same, what a tenth of the airframes exceed.
    pub best_ratio_worst_decile: f64,
    /// Of an attitude source with noise alone, which the solver was told.
    pub coverage: Coverage,
    /// Of a source with the constant errors that the module allows for ([`Consider::DEFAULT`]).
    pub coverage_with_faults: Coverage,
}

/// Runs the plan for one flight; `tick` is called once an airframe, from any thread.
#[must_use]
pub fn run(flight: Flight, plan: Plan, tick: &(dyn Fn() + Sync)) -> Row {
    let trials: Vec<Tried> = (plan.seed..plan.seed + plan.airframes)
        .into_par_iter()
        .filter_map(|seed| {
            let tried = Tried::of(flight, seed, plan.draws);
            tick();
            tried
        })
        .collect();
    row(flight, &trials)
}

/// One airframe.
struct Tried {
    readings: usize,
    kept_bound_deg: f64,
    best_bound_deg: f64,
    counts: Counts,
    /// Errors over their sigmas.
    normalised: Vec<f64>,
    normalised_with_faults: Vec<f64>,
}

impl Tried {
    /// `None` when the flight does not determine the coefficients at all.
    fn of(flight: Flight, seed: u64, draws: u64) -> Option<Self> {
        let envelope = if flight.kind == Kind::Plane { Envelope::Banked } else { Envelope::Tilted };
        let trial = Trial::draw(&Ranges::HARSH, seed).flying(flight.fly(&Ranges::HARSH, seed), envelope);
        let kept: BTreeSet<u32> = collected::collect(&trial.record_all(0, Faults::NONE).0)
            .samples()
            .all()
            .map(|sample| sample.time.count())
            .collect();
        let kept_instants = trial.instants().filter(|instant| kept.contains(&instant.time.count()));
        let readings = kept.len();
        let mut tried = Self {
            readings,
            kept_bound_deg: bound::rms_deg_of(&trial, kept_instants)?,
            best_bound_deg: greedy::rms_deg(&trial, readings)?,
            counts: Counts::default(),
            normalised: Vec::new(),
            normalised_with_faults: Vec::new(),
        };
        for draw in 0..draws {
            let recorded = collected::collect(&trial.record_all(draw, Faults::NONE).0);
            let solution = solve(Method::MaximumLikelihood, recorded.samples(), Consider::DEFAULT).ok();
            tried.counts.add(&trial, &recorded, solution.as_ref());
            if draw % COVERAGE_EVERY == 0 {
                tried.normalised.extend(use_headings(&trial, draw, Consider::NOTHING));
                tried.normalised_with_faults.extend(use_headings(&trial, draw, Consider::DEFAULT));
            }
        }
        Some(tried)
    }
}

/// Errors over sigmas of headings after a flight with an attitude source that has what is considered, and nothing else.
fn use_headings(trial: &Trial, draw: u64, consider: Consider) -> Vec<f64> {
    let (samples, mut used) = trial.record_all(draw, Faults::of(consider));
    let recorded = collected::collect(&samples);
    let Ok(solution) = solve(Method::MaximumLikelihood, recorded.samples(), consider) else { return Vec::new() };
    (0..HEADINGS).filter_map(|_| trial.error_over_sigma(&solution, &mut used)).collect()
}

fn row(flight: Flight, trials: &[Tried]) -> Row {
    let sum = |of: fn(&Counts) -> u32| trials.iter().map(|tried| of(&tried.counts)).sum::<u32>();
    let (solved, refused) = (sum(|c| c.solved), sum(|c| c.refused));
    let percent = |part: u32| 100.0 * f64::from(part) / f64::from((solved + refused).max(1));
    let solved_ones = || trials.iter().filter(|tried| tried.counts.solved > 0);
    let rms_deg = |part| quantile(solved_ones().map(|tried| tried.counts.rms_deg()), part);
    let ratio = |part| quantile(solved_ones().map(|tried| tried.counts.rms_deg() / tried.best_bound_deg), part);
    let kept_ratios = solved_ones().map(|tried| tried.counts.rms_deg() / tried.kept_bound_deg);
    let all_of = |errors: fn(&Tried) -> &Vec<f64>| trials.iter().flat_map(errors).copied().collect::<Vec<f64>>();
    Row {
        aircraft: flight.kind.name(),
        pattern: flight.pattern,
        minutes: flight.minutes,
        readings: quantile(trials.iter().map(|tried| tried.readings as f64), 0.5),
        converged_percent: percent(solved),
        accepted_percent: percent(sum(|c| c.accepted)),
        wrong: sum(|c| c.wrong),
        rms_median_deg: rms_deg(0.5),
        rms_worst_decile_deg: rms_deg(0.9),
        kept_ratio_median: quantile(kept_ratios, 0.5),
        choice_ratio_median: quantile(trials.iter().map(|tried| tried.kept_bound_deg / tried.best_bound_deg), 0.5),
        best_bound_median_deg: quantile(trials.iter().map(|tried| tried.best_bound_deg), 0.5),
        best_ratio_median: ratio(0.5),
        best_ratio_worst_decile: ratio(0.9),
        coverage: coverage(&all_of(|tried| &tried.normalised)),
        coverage_with_faults: coverage(&all_of(|tried| &tried.normalised_with_faults)),
    }
}
