//! Detects a change of a magnetometer in flight: its gain, the sign or gain of an axis, or its registers.
//!
//! Iron is additive; a change of the sensor is proportional to the reading. At candidate times both hypotheses are fitted
//! together with the correction, and compared by the Bayesian information criterion (G. Schwarz, "Estimating the
//! dimension of a model", 1978) of residuals that are correlated for seconds.

mod change_fit;

use std::fmt;

use autoswing::calibration::Solution;
use nalgebra::Vector3;

use self::change_fit::{ChangeFit, FitRow, Hypothesis, Scales};
use super::hard_iron_changes::LoggedHardIronChange;
use super::hard_iron_jump::find_jump_times_s;
use super::replay_run::solve_all_rows;
use super::row_solve::solved_correction;
use super::rows;
use crate::log::FieldCorrection;
use crate::numbers::square;
use crate::replay::row::ReplayRow;

/// A change of the sensor in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorChange {
    /// Flight time of the change, seconds.
    pub time_s: f64,
    /// What changed.
    pub kind: SensorChangeKind,
}

/// Changed property of a sensor. Axes are body axes: those of the sensor, if it is mounted at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorChangeKind {
    /// Gain of all axes: readings after the change relative to those before it.
    Gain {
        /// Ratio of the readings.
        factor: f64,
    },
    /// Sign of an axis, 0 to 2.
    AxisSign {
        /// Axis, 0 to 2.
        axis: usize,
    },
    /// Gain of an axis.
    AxisGain {
        /// Axis, 0 to 2.
        axis: usize,
        /// Ratio of the readings.
        factor: f64,
    },
    /// Gain per axis and offset, as by a reset of the registers.
    Registers,
}

impl SensorChange {
    /// Whether a change of hard iron was found at the time of the change, and is the sensor's.
    #[must_use]
    pub fn appears_as(&self, change: &LoggedHardIronChange) -> bool {
        (change.hard_iron_step.time_s - self.time_s).abs() <= MAX_APPARENT_IRON_S
    }
}

impl fmt::Display for SensorChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |axis: usize| ["x", "y", "z"][axis.min(2)];
        match self.kind {
            SensorChangeKind::Gain { factor } => write!(f, "the sensor's gain changed by a factor of {factor:.2}")?,
            SensorChangeKind::AxisSign { axis } => write!(f, "the sign of the sensor's {} axis changed", name(axis))?,
            SensorChangeKind::AxisGain { axis, factor } => {
                write!(f, "the gain of the sensor's {} axis changed by a factor of {factor:.2}", name(axis))?;
            }
            SensorChangeKind::Registers => {
                f.write_str("the sensor's gains and offset changed, as by a reset of its registers,")?;
            }
        }
        write!(f, " at {:.0} s: that is the sensor, not iron; no parameters fit both", self.time_s)
    }
}

/// Largest number of rows in a fit.
const MAX_FITTED_ROWS: usize = 1200;
/// Least number of rows on a side.
const MIN_ROWS_PER_SIDE: usize = 100;
/// Time on either side of a change that is not fitted, seconds: the rows are averages, and the time is uncertain.
const SKIPPED_S: f64 = 0.5;
/// Correlation time of the residuals, seconds: that of attitude errors.
const CORRELATION_S: f64 = 2.0;

/// Largest time between a change of the sensor and the change of hard iron that it appears as, seconds.
const MAX_APPARENT_IRON_S: f64 = 2.0;

/// Candidates closer than this are one, seconds.
const MAX_SAME_TIME_S: f64 = 1.0;
/// Largest number of jumps that are candidates; more are of another cause, such as wrong body rates.
const MAX_JUMPS: usize = 8;

/// Least increase of the residuals of a fit to both sides, relative to the fits of each side, for a change.
const MIN_SCALE_RATIO: f64 = 1.2;

/// Least evidence for a change of the sensor against no change, natural logarithm of the ratio of probabilities.
const MIN_EVIDENCE: f64 = 20.0;
/// Least evidence against hard iron: of a gain of all axes; of an axis, which iron along that axis resembles on a single
/// heading; of registers, which include iron.
const MIN_EVIDENCE_OF_GAIN: f64 = 6.0;
const MIN_EVIDENCE_OF_AXIS_GAIN: f64 = 12.0;
const MIN_EVIDENCE_OF_REGISTERS: f64 = 40.0;

/// Largest increase of the objective per row over the fits of each side at which hard iron explains a change.
const MAX_IRON_MISFIT: f64 = 0.05;

/// Largest part of the misfit without a change that may remain: negative log-likelihood above that of the fits of each
/// side.
const MAX_REMAINING_MISFIT: f64 = 0.2;
/// Largest ratio between the residuals of both sides, beside the gain that amplifies noise: at a wrong time, one side
/// contains rows of both.
const MAX_SIDE_RATIO: f64 = 4.0;

/// Smallest changes of the gain of all axes, of an axis, and of the most changed one of several.
const MIN_GAIN_CHANGE: f64 = 0.02;
const MIN_AXIS_GAIN_CHANGE: f64 = 0.05;
const MIN_REGISTER_CHANGE: f64 = 0.15;
/// Largest deviation of a factor from -1 for a change of sign.
const MAX_SIGN_DEVIATION: f64 = 0.15;
/// Largest gain that is one; the reciprocal of an axis that is stuck is larger.
const MAX_FACTOR: f64 = 20.0;

/// Gains from which a fit starts; those with the smallest objective are fitted.
const START_GAINS: [f64; 7] = [0.4, 0.6, 0.8, 1.0, 1.25, 1.7, 2.5];
const FITTED_STARTS: usize = 2;

/// Finds the change of the sensor with the most evidence. `initial` is a correction that fits most of the rows.
#[must_use]
pub fn find_sensor_change(
    rows: &[ReplayRow],
    initial: &FieldCorrection,
    changes: &[LoggedHardIronChange],
) -> Option<SensorChange> {
    let usable: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable).copied().collect();
    let changes_s: Vec<f64> = changes.iter().map(|change| change.hard_iron_step.time_s).collect();
    let mut times_s = [changes_s.clone(), candidate_times_s(&usable, initial)].concat();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup_by(|later, earlier| *later - *earlier < MAX_SAME_TIME_S);
    // A change of hard iron at another time spoils the fits: then only the rows up to that time are compared.
    decide_among(&usable, &times_s).or_else(|| {
        times_s.iter().find_map(|&time_s| {
            let part = rows_around(&usable, time_s, &changes_s);
            if part.len() < usable.len() { decide_among(part, &[time_s]) } else { None }
        })
    })
}

/// The change of the sensor at the candidate time with the best fit of any hypothesis, if that is evident.
fn decide_among(rows: &[ReplayRow], times_s: &[f64]) -> Option<SensorChange> {
    let comparisons = times_s.iter().filter_map(|&time_s| Comparison::new(rows, time_s));
    let best = comparisons.min_by(|a, b| a.mean_objective().total_cmp(&b.mean_objective()))?;
    let refined_s = best.refined_time_s(rows)?;
    if (refined_s - best.time_s).abs() < SKIPPED_S {
        return best.decide(refined_s);
    }
    Comparison::new(rows, refined_s)?.decide(refined_s)
}

/// Rows between the changes before and after a time.
fn rows_around<'rows>(rows: &'rows [ReplayRow], time_s: f64, changes_s: &[f64]) -> &'rows [ReplayRow] {
    let others = || changes_s.iter().filter(|other_s| (**other_s - time_s).abs() > 2.0 * MAX_SAME_TIME_S);
    let from_s = others().filter(|other_s| **other_s < time_s).copied().fold(f64::NEG_INFINITY, f64::max);
    let to_s = others().filter(|other_s| **other_s > time_s).copied().fold(f64::INFINITY, f64::min);
    let index = |at_s: f64| rows.partition_point(|row| row.t_s < at_s);
    &rows[index(from_s + SKIPPED_S)..index(to_s - SKIPPED_S)]
}

/// Times at which the field jumps, or its residuals to a fit of one half of the rows change their scatter.
fn candidate_times_s(rows: &[ReplayRow], initial: &FieldCorrection) -> Vec<f64> {
    let (first, second) = rows.split_at(rows.len() / 2);
    let solved = [first, second].map(|half| solve_all_rows(half).as_ref().map(solved_correction));
    let mut times_s = Vec::new();
    for correction in solved.into_iter().flatten().chain([*initial]) {
        times_s.extend(change_of_scatter_s(rows, &correction));
        let jumps_s = find_jump_times_s(rows, &correction);
        if jumps_s.len() <= MAX_JUMPS {
            times_s.extend(jumps_s);
        }
    }
    times_s
}

/// Time that divides the rows into two parts of the least scatter about their own means of strength and vertical
/// component, seconds.
fn change_of_scatter_s(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    let residuals = |row: &ReplayRow| {
        let field = row.corrected_field(correction);
        [field.norm(), row.down_in_body().dot(&field)]
    };
    let sums_to: Vec<ScatterSums> = rows
        .iter()
        .scan(ScatterSums::default(), |sums, row| Some(std::mem::replace(sums, sums.with_row(residuals(row)))))
        .collect();
    let total = sums_to.last()?.with_row(residuals(rows.last()?));
    let cost = |i: usize| sums_to[i].cost() + total.less(&sums_to[i]).cost();
    let divisions = MIN_ROWS_PER_SIDE..rows.len().saturating_sub(MIN_ROWS_PER_SIDE);
    divisions.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map(|i| rows[i].t_s)
}

/// Sums over rows, of strength and vertical component.
#[derive(Clone, Copy, Default)]
struct ScatterSums {
    count: f64,
    sums_ut: [f64; 2],
    squares_ut2: [f64; 2],
}

impl ScatterSums {
    fn with_row(&self, residuals_ut: [f64; 2]) -> Self {
        Self {
            count: self.count + 1.0,
            sums_ut: [0, 1].map(|i| self.sums_ut[i] + residuals_ut[i]),
            squares_ut2: [0, 1].map(|i| self.squares_ut2[i] + square(residuals_ut[i])),
        }
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            count: self.count - other.count,
            sums_ut: [0, 1].map(|i| self.sums_ut[i] - other.sums_ut[i]),
            squares_ut2: [0, 1].map(|i| self.squares_ut2[i] - other.squares_ut2[i]),
        }
    }

    /// Negative log-likelihood of normally distributed rows about their mean.
    fn cost(&self) -> f64 {
        let variance = |i: usize| self.squares_ut2[i] / self.count - square(self.sums_ut[i] / self.count);
        let logs = [0, 1].map(|i| libm::log(variance(i).max(square(MIN_SCATTER_UT))));
        self.count * (logs[0] + logs[1])
    }
}

/// Smallest scatter that is compared, microtesla.
const MIN_SCATTER_UT: f64 = 0.01;

/// Fits of all hypotheses to the rows on both sides of a time.
struct Comparison {
    time_s: f64,
    rows: Vec<FitRow>,
    is_later_changed: bool,
    fits: Vec<FittedHypothesis>,
    /// Negative log-likelihood of the separate fits of both sides.
    separate_likelihood: f64,
    scales: Scales,
}

struct FittedHypothesis {
    hypothesis: Hypothesis,
    fit: ChangeFit,
    negative_log_evidence: f64,
}

impl Comparison {
    /// Fits the hypotheses; none if rows or a fit are missing, or no change is apparent.
    fn new(rows: &[ReplayRow], time_s: f64) -> Option<Self> {
        let stride = rows.len().div_ceil(MAX_FITTED_ROWS).max(1);
        let correlated_rows = (CORRELATION_S / (rows::median_step_s(rows)? * stride as f64)).max(1.0);
        let before = &rows[..rows.partition_point(|row| row.t_s < time_s - SKIPPED_S)];
        let after = &rows[rows.partition_point(|row| row.t_s <= time_s + SKIPPED_S)..];
        if before.len().min(after.len()) < MIN_ROWS_PER_SIDE {
            return None;
        }
        let solutions = [before, after].map(solve_all_rows);
        let [error_before, error_after] = [0, 1].map(|i| {
            let errors_deg = solutions[i].as_ref().map(|solution: &Solution| solution.quality.expected_rms_deg);
            // An expected error of zero is that of a degenerate solution.
            errors_deg.filter(|error_deg| *error_deg > 0.0).unwrap_or(f32::INFINITY)
        });
        let is_later_changed = error_before <= error_after;
        let [correction_before, correction_after] = solutions.map(|solution| solution.as_ref().map(solved_correction));
        let (correction, other) = if is_later_changed {
            (correction_before?, correction_after)
        } else {
            (correction_after?, correction_before)
        };
        let thinned = |side: &[ReplayRow], is_changed| -> Vec<FitRow> {
            side.iter().step_by(stride).map(|row| FitRow::new(row, is_changed)).collect()
        };
        let rows = [thinned(before, !is_later_changed), thinned(after, is_later_changed)].concat();
        let base = ChangeFit::from_correction(&rows, &correction);
        let separate = base.fitted_separately(&rows, other.as_ref());
        let separate_scales = combined_scales(&rows, &separate);
        let unchanged = base.fitted(&rows, Hypothesis::Unchanged);
        let is_apparent = unchanged
            .scales_ut(&rows)
            .iter()
            .zip(&separate_scales)
            .any(|(scale, separate)| *scale > MIN_SCALE_RATIO * separate);
        if !is_apparent {
            return None;
        }
        let fitted = |hypothesis| (hypothesis, best_fit(&rows, &base, other.as_ref(), hypothesis));
        let mut fits = vec![(Hypothesis::Unchanged, unchanged), fitted(Hypothesis::HardIron), fitted(Hypothesis::Gain)];
        let iron = &fits[1].1;
        let is_iron = is_balanced(&rows, iron)
            && combined_objective(&rows, &separate) + MAX_IRON_MISFIT * rows.len() as f64 > iron.objective(&rows);
        if !is_iron {
            fits.extend(Hypothesis::OF_AXES.map(fitted));
        }
        let all_scales: Vec<Scales> =
            fits.iter().map(|(_, fit)| fit.scales_ut(&rows)).chain([separate_scales]).collect();
        let scales: Scales =
            std::array::from_fn(|group| all_scales.iter().map(|scales| scales[group]).fold(f64::INFINITY, f64::min));
        let separate_likelihood =
            [0, 1].map(|side| separate[side].negative_log_likelihood(&rows_of_side(&rows, side), &scales)).iter().sum();
        let fits = fits
            .into_iter()
            .map(|(hypothesis, fit)| FittedHypothesis {
                hypothesis,
                fit,
                negative_log_evidence: fit.negative_log_evidence(&rows, hypothesis, &scales, correlated_rows),
            })
            .collect();
        Some(Self { time_s, rows, is_later_changed, fits, separate_likelihood, scales })
    }

    /// Objective of the best hypothesis per row, comparable between times.
    fn mean_objective(&self) -> f64 {
        let objectives = self.fits.iter().map(|fitted| fitted.fit.objective(&self.rows) / self.rows.len() as f64);
        objectives.fold(f64::INFINITY, f64::min)
    }

    fn fit_of(&self, hypothesis: Hypothesis) -> Option<&ChangeFit> {
        self.fits.iter().find(|fitted| fitted.hypothesis == hypothesis).map(|fitted| &fitted.fit)
    }

    fn is_iron_balanced(&self) -> bool {
        self.fit_of(Hypothesis::HardIron).is_some_and(|iron| is_balanced(&self.rows, iron))
    }

    fn cost(&self, hypothesis: Hypothesis) -> f64 {
        let fitted = self.fits.iter().find(|fitted| fitted.hypothesis == hypothesis);
        fitted.map_or(f64::INFINITY, |fitted| fitted.negative_log_evidence)
    }

    /// The most probable change of the sensor.
    fn best_sensor_fit(&self) -> Option<&FittedHypothesis> {
        let sensor = self.fits.iter().filter(|fitted| fitted.hypothesis.is_of_sensor());
        sensor.min_by(|a, b| a.negative_log_evidence.total_cmp(&b.negative_log_evidence))
    }

    /// Time that divides the rows best into unchanged and changed ones by the most probable change of the sensor.
    fn refined_time_s(&self, rows: &[ReplayRow]) -> Option<f64> {
        let fit = self.best_sensor_fit()?.fit;
        let mut sum = 0.0;
        let sums = rows.iter().map(|row| {
            let before_sum = sum;
            let of_side = |is_later: bool| {
                let is_changed = is_later == self.is_later_changed;
                fit.negative_log_likelihood(&[FitRow::new(row, is_changed)], &self.scales)
            };
            sum += of_side(false) - of_side(true);
            (row.t_s, before_sum)
        });
        sums.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(time_s, _)| time_s)
    }

    /// The change of the sensor at a time, if there is sufficient evidence.
    fn decide(&self, time_s: f64) -> Option<SensorChange> {
        let best = self.best_sensor_fit()?;
        let evidence = |other: Hypothesis| self.cost(other) - best.negative_log_evidence;
        let min_against_iron = match best.hypothesis {
            Hypothesis::Registers => MIN_EVIDENCE_OF_REGISTERS,
            Hypothesis::AxisGain(_) => MIN_EVIDENCE_OF_AXIS_GAIN,
            _ => MIN_EVIDENCE_OF_GAIN,
        };
        let is_evident = evidence(Hypothesis::Unchanged) > MIN_EVIDENCE
            && evidence(Hypothesis::HardIron) > min_against_iron
            && self.is_fitted(&best.fit)
            && (best.hypothesis != Hypothesis::Registers || !self.is_iron_balanced());
        let kind = kind_of(best.hypothesis, &self.factors(&best.fit)).filter(|_| is_evident)?;
        Some(SensorChange { time_s, kind })
    }

    /// Whether a hypothesis explains most of the misfit, and fits both sides equally well.
    fn is_fitted(&self, fit: &ChangeFit) -> bool {
        let misfit = |fit: &ChangeFit| fit.negative_log_likelihood(&self.rows, &self.scales) - self.separate_likelihood;
        let unchanged = self.fit_of(Hypothesis::Unchanged);
        is_balanced(&self.rows, fit)
            && unchanged.is_some_and(|unchanged| misfit(fit) < MAX_REMAINING_MISFIT * misfit(unchanged))
    }

    /// Ratios of the readings after the change to those before it, by axis.
    fn factors(&self, fit: &ChangeFit) -> Vector3<f64> {
        if self.is_later_changed { fit.gain.map(f64::recip) } else { fit.gain }
    }
}

/// Whether the residuals of both sides are alike, beside the gains that amplify the noise.
fn is_balanced(rows: &[FitRow], fit: &ChangeFit) -> bool {
    let scales = fit.scales_ut(rows);
    let (amplified, attenuated) = (fit.gain.abs().max().max(1.0), fit.gain.abs().min().min(1.0));
    [0, 1].into_iter().all(|i| {
        let ratio = scales[2 + i] / scales[i];
        ratio < MAX_SIDE_RATIO * amplified && ratio > attenuated / MAX_SIDE_RATIO
    })
}

/// The change by a hypothesis, unless too small or that of a stuck axis.
fn kind_of(hypothesis: Hypothesis, factors: &Vector3<f64>) -> Option<SensorChangeKind> {
    let is_gain = factors.iter().all(|factor| (MAX_FACTOR.recip()..MAX_FACTOR).contains(&factor.abs()));
    let exceeds = |factor: f64, least: f64| (factor - 1.0).abs() >= least;
    let kind = match hypothesis {
        Hypothesis::Gain => exceeds(factors.x, MIN_GAIN_CHANGE).then_some(SensorChangeKind::Gain { factor: factors.x }),
        Hypothesis::AxisGain(axis) if (factors[axis] + 1.0).abs() < MAX_SIGN_DEVIATION => {
            Some(SensorChangeKind::AxisSign { axis })
        }
        Hypothesis::AxisGain(axis) => exceeds(factors[axis], MIN_AXIS_GAIN_CHANGE)
            .then_some(SensorChangeKind::AxisGain { axis, factor: factors[axis] }),
        Hypothesis::Registers => {
            factors.iter().any(|factor| exceeds(*factor, MIN_REGISTER_CHANGE)).then_some(SensorChangeKind::Registers)
        }
        Hypothesis::Unchanged | Hypothesis::HardIron => None,
    };
    kind.filter(|_| is_gain)
}

/// Rows of the unchanged side, 0, or of the changed one, 1.
fn rows_of_side(rows: &[FitRow], side: usize) -> Vec<FitRow> {
    rows.iter().filter(|row| row.is_changed == (side == 1)).copied().collect()
}

/// Objective of separate fits of both sides.
fn combined_objective(rows: &[FitRow], fits: &[ChangeFit; 2]) -> f64 {
    [0, 1].iter().map(|&side| fits[side].objective(&rows_of_side(rows, side))).sum()
}

/// Scales of the unchanged side by the first fit, and of the changed side by the second.
fn combined_scales(rows: &[FitRow], [unchanged, changed]: &[ChangeFit; 2]) -> Scales {
    let (first, second) = (unchanged.scales_ut(rows), changed.scales_ut(rows));
    [first[0], first[1], second[2], second[3]]
}

/// Best fit of a hypothesis from several starts.
fn best_fit(rows: &[FitRow], base: &ChangeFit, other: Option<&FieldCorrection>, hypothesis: Hypothesis) -> ChangeFit {
    let mut starts = starts_of(rows, base, other, hypothesis);
    starts.sort_by(|a, b| a.objective(rows).total_cmp(&b.objective(rows)));
    let fits = starts.into_iter().take(FITTED_STARTS).map(|start| start.fitted(rows, hypothesis));
    fits.min_by(|a, b| a.objective(rows).total_cmp(&b.objective(rows))).unwrap_or(*base)
}

fn starts_of(
    rows: &[FitRow],
    base: &ChangeFit,
    other: Option<&FieldCorrection>,
    hypothesis: Hypothesis,
) -> Vec<ChangeFit> {
    let scaled = |gain: Vector3<f64>| base.with_change(gain, Vector3::zeros());
    match hypothesis {
        Hypothesis::Unchanged => vec![*base],
        Hypothesis::HardIron => other.map(|other| base.with_other_iron(other)).into_iter().chain([*base]).collect(),
        Hypothesis::Gain => START_GAINS.map(|gain| scaled(Vector3::repeat(gain))).to_vec(),
        Hypothesis::AxisGain(axis) => {
            let gains = START_GAINS.into_iter().chain([-1.0]);
            gains.map(|gain| scaled(Vector3::from_fn(|i, _| if i == axis { gain } else { 1.0 }))).collect()
        }
        Hypothesis::Registers => {
            let starts = [other.and_then(|other| base.with_other(other)), base.with_linear_change(rows), Some(*base)];
            starts.into_iter().flatten().collect()
        }
    }
}

#[cfg(test)]
mod tests;
