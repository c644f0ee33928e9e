//! Compares the hypotheses of a change at a time.

use std::fmt;

use autoswing::calibration::Solution;
use nalgebra::Vector3;

use crate::log::FieldCorrection;
use crate::replay::change_fit::{ChangeFit, FitRow, Hypothesis, Scales};
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;
use crate::replay::rows;

/// Correlation time of the residuals, seconds: that of attitude errors.
const CORRELATION_S: f64 = 2.0;

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

/// Fits of all hypotheses to the rows on both sides of a time.
pub(super) struct Comparison {
    /// Candidate time, seconds.
    pub time_s: f64,
    rows: Vec<FitRow>,
    /// Whether the hypotheses transform the readings of the later side.
    is_later_changed: bool,
    fits: Vec<FittedHypothesis>,
    /// Negative log-likelihood of the separate fits of both sides.
    separate_likelihood: f64,
    /// Smallest scales of all fits.
    scales: Scales,
}

/// Fit of a hypothesis with its evidence.
struct FittedHypothesis {
    hypothesis: Hypothesis,
    fit: ChangeFit,
    negative_log_evidence: f64,
}

/// Rows on both sides of a time, and corrections that fit each side.
struct Sides {
    rows: Vec<FitRow>,
    is_later_changed: bool,
    /// Estimate without a change, by the correction of the side with the smaller expected error.
    base: ChangeFit,
    /// Correction of the other side, whose readings a hypothesis transforms; none without a solution.
    other: Option<FieldCorrection>,
    /// Number of successive rows with correlated residuals.
    correlated_rows: f64,
}

impl Sides {
    /// Rows before and after a time; none if rows, or a fit to one side, are missing.
    fn new(rows: &[ReplayRow], time_s: f64) -> Option<Self> {
        let stride = rows.len().div_ceil(MAX_FITTED_ROWS).max(1);
        let correlated_rows = (CORRELATION_S / (rows::median_step_s(rows)? * stride as f64)).max(1.0);
        let before = &rows[..rows.partition_point(|row| row.t_s < time_s - SKIPPED_S)];
        let after = &rows[rows.partition_point(|row| row.t_s <= time_s + SKIPPED_S)..];
        if before.len().min(after.len()) < MIN_ROWS_PER_SIDE {
            return None;
        }
        let [solution_before, solution_after] = [before, after].map(solve_all_rows);
        let is_later_changed =
            expected_error_deg(solution_before.as_ref()) <= expected_error_deg(solution_after.as_ref());
        let (solution, other) =
            if is_later_changed { (solution_before, solution_after) } else { (solution_after, solution_before) };
        let thinned = |side: &[ReplayRow], is_changed| -> Vec<FitRow> {
            side.iter().step_by(stride).map(|row| FitRow::new(row, is_changed)).collect()
        };
        let rows = [thinned(before, !is_later_changed), thinned(after, is_later_changed)].concat();
        let base = ChangeFit::from_correction(&rows, &solved_correction(&solution?));
        Some(Self { rows, is_later_changed, base, other: other.as_ref().map(solved_correction), correlated_rows })
    }

    /// Best fit of a hypothesis from several starts.
    fn fitted(&self, hypothesis: Hypothesis) -> ChangeFit {
        let objective = |fit: &ChangeFit| fit.objective(&self.rows);
        let mut starts = self.starts_of(hypothesis);
        starts.sort_by(|a, b| objective(a).total_cmp(&objective(b)));
        let fits = starts.into_iter().take(FITTED_STARTS).map(|start| start.fitted(&self.rows, hypothesis));
        fits.min_by(|a, b| objective(a).total_cmp(&objective(b))).unwrap_or(self.base)
    }

    fn starts_of(&self, hypothesis: Hypothesis) -> Vec<ChangeFit> {
        let (base, other) = (&self.base, self.other.as_ref());
        let scaled = |gain: Vector3<f64>| base.with_change(gain, Vector3::zeros());
        let starts = match hypothesis {
            Hypothesis::Unchanged => vec![Some(*base)],
            Hypothesis::HardIron => vec![other.map(|other| base.with_other_iron(other)), Some(*base)],
            Hypothesis::Gain => START_GAINS.map(|gain| Some(scaled(Vector3::repeat(gain)))).to_vec(),
            Hypothesis::AxisGain(axis) => {
                let gains = START_GAINS.into_iter().chain([-1.0]);
                gains.map(|gain| Some(scaled(Vector3::from_fn(|i, _| if i == axis { gain } else { 1.0 })))).collect()
            }
            Hypothesis::Registers => {
                vec![other.and_then(|other| base.with_other(other)), base.with_linear_change(&self.rows), Some(*base)]
            }
        };
        starts.into_iter().flatten().collect()
    }

    /// Fits of the hypotheses; none if no change is apparent. The axes are not compared if hard iron fits as well as
    /// separate fits of both sides.
    fn fitted_hypotheses(&self, separate: &[ChangeFit; 2]) -> Option<Vec<(Hypothesis, ChangeFit)>> {
        let rows = &self.rows;
        let unchanged = self.fitted(Hypothesis::Unchanged);
        let scales = unchanged.scales_ut(rows).into_iter().zip(combined_scales(rows, separate));
        if scales.into_iter().all(|(scale, separate)| scale <= MIN_SCALE_RATIO * separate) {
            return None;
        }
        let iron = self.fitted(Hypothesis::HardIron);
        let limit = combined_objective(rows, separate) + MAX_IRON_MISFIT * rows.len() as f64;
        let is_iron = is_balanced(rows, &iron) && iron.objective(rows) < limit;
        let of_axes: &[Hypothesis] = if is_iron { &[] } else { &Hypothesis::OF_AXES };
        let of_sensor =
            [Hypothesis::Gain].iter().chain(of_axes).map(|&hypothesis| (hypothesis, self.fitted(hypothesis)));
        Some([(Hypothesis::Unchanged, unchanged), (Hypothesis::HardIron, iron)].into_iter().chain(of_sensor).collect())
    }
}

/// Expected error of a solution, degrees RMS. Zero is that of a degenerate solution.
fn expected_error_deg(solution: Option<&Solution>) -> f32 {
    let error_deg = solution.map(|solution| solution.quality.expected_rms_deg);
    error_deg.filter(|error_deg| *error_deg > 0.0).unwrap_or(f32::INFINITY)
}

impl Comparison {
    /// Fits the hypotheses; none if rows or a fit are missing, or no change is apparent.
    pub fn new(rows: &[ReplayRow], time_s: f64) -> Option<Self> {
        let sides = Sides::new(rows, time_s)?;
        let separate = sides.base.fitted_separately(&sides.rows, sides.other.as_ref());
        let fits = sides.fitted_hypotheses(&separate)?;
        let Sides { rows, is_later_changed, correlated_rows, .. } = sides;
        let scales = fits
            .iter()
            .map(|(_, fit)| fit.scales_ut(&rows))
            .fold(combined_scales(&rows, &separate), |smallest, scales| {
                std::array::from_fn(|group| smallest[group].min(scales[group]))
            });
        let separate_likelihood =
            [0, 1].map(|side| separate[side].negative_log_likelihood(&rows_of_side(&rows, side), &scales)).iter().sum();
        let with_evidence = |(hypothesis, fit): (Hypothesis, ChangeFit)| FittedHypothesis {
            hypothesis,
            fit,
            negative_log_evidence: fit.negative_log_evidence(&rows, hypothesis, &scales, correlated_rows),
        };
        let fits = fits.into_iter().map(with_evidence).collect();
        Some(Self { time_s, rows, is_later_changed, fits, separate_likelihood, scales })
    }

    /// Objective of the best hypothesis per row, comparable between times.
    pub fn mean_objective(&self) -> f64 {
        let objectives = self.fits.iter().map(|fitted| fitted.fit.objective(&self.rows) / self.rows.len() as f64);
        objectives.fold(f64::INFINITY, f64::min)
    }

    fn fit_of(&self, hypothesis: Hypothesis) -> Option<&FittedHypothesis> {
        self.fits.iter().find(|fitted| fitted.hypothesis == hypothesis)
    }

    /// The most probable change of the sensor.
    fn best_sensor_fit(&self) -> Option<&FittedHypothesis> {
        let sensor = self.fits.iter().filter(|fitted| fitted.hypothesis.is_of_sensor());
        sensor.min_by(|a, b| a.negative_log_evidence.total_cmp(&b.negative_log_evidence))
    }

    /// Time that divides the rows best into unchanged and changed ones by the most probable change of the sensor.
    pub fn refined_time_s(&self, rows: &[ReplayRow]) -> Option<f64> {
        let earlier: Vec<FitRow> = rows.iter().map(|row| FitRow::new(row, !self.is_later_changed)).collect();
        let index = self.best_sensor_fit()?.fit.likeliest_division(&earlier, &self.scales, 0)?;
        Some(rows.get(index)?.t_s)
    }

    /// The change of the sensor at a time, if there is sufficient evidence.
    pub fn decide(&self, time_s: f64) -> Option<SensorChange> {
        let best = self.best_sensor_fit()?;
        let [unchanged, iron] = [Hypothesis::Unchanged, Hypothesis::HardIron].map(|other| self.fit_of(other));
        let (unchanged, iron) = (unchanged?, iron?);
        let evidence = |other: &FittedHypothesis| other.negative_log_evidence - best.negative_log_evidence;
        let min_against_iron = match best.hypothesis {
            Hypothesis::Registers => MIN_EVIDENCE_OF_REGISTERS,
            Hypothesis::AxisGain(_) => MIN_EVIDENCE_OF_AXIS_GAIN,
            _ => MIN_EVIDENCE_OF_GAIN,
        };
        let is_evident = evidence(unchanged) > MIN_EVIDENCE
            && evidence(iron) > min_against_iron
            && self.is_fitted(&best.fit, &unchanged.fit)
            && (best.hypothesis != Hypothesis::Registers || !is_balanced(&self.rows, &iron.fit));
        let factors = self.factors(&best.fit);
        (is_evident && is_large(best.hypothesis, &factors)).then_some(SensorChange {
            time_s,
            hypothesis: best.hypothesis,
            factors,
        })
    }

    /// Whether a hypothesis explains most of the misfit, and fits both sides equally well.
    fn is_fitted(&self, fit: &ChangeFit, unchanged: &ChangeFit) -> bool {
        let misfit = |fit: &ChangeFit| fit.negative_log_likelihood(&self.rows, &self.scales) - self.separate_likelihood;
        is_balanced(&self.rows, fit) && misfit(fit) < MAX_REMAINING_MISFIT * misfit(unchanged)
    }

    /// Ratios of the readings after the change to those before it, by axis.
    fn factors(&self, fit: &ChangeFit) -> Vector3<f64> {
        if self.is_later_changed { fit.gain.map(f64::recip) } else { fit.gain }
    }
}

/// Whether the residuals of both sides have the same size, apart from gains that amplify the noise.
fn is_balanced(rows: &[FitRow], fit: &ChangeFit) -> bool {
    let scales = fit.scales_ut(rows);
    let (amplified, attenuated) = (fit.gain.abs().max().max(1.0), fit.gain.abs().min().min(1.0));
    [0, 1].into_iter().all(|i| {
        let ratio = scales[2 + i] / scales[i];
        ratio < MAX_SIDE_RATIO * amplified && ratio > attenuated / MAX_SIDE_RATIO
    })
}

/// Whether factors of the readings are those of a changed sensor: neither too small, nor those of a stuck axis.
pub(super) fn is_large(hypothesis: Hypothesis, factors: &Vector3<f64>) -> bool {
    let min_change = match hypothesis {
        Hypothesis::Gain => MIN_GAIN_CHANGE,
        Hypothesis::AxisGain(_) => MIN_AXIS_GAIN_CHANGE,
        Hypothesis::Registers => MIN_REGISTER_CHANGE,
        Hypothesis::Unchanged | Hypothesis::HardIron => return false,
    };
    let is_gain = factors.iter().all(|factor| (MAX_FACTOR.recip()..MAX_FACTOR).contains(&factor.abs()));
    is_gain && factors.add_scalar(-1.0).amax() >= min_change
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

/// A change of the sensor in flight. Axes are body axes: those of the sensor, if it is mounted at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorChange {
    /// Flight time of the change, seconds.
    pub time_s: f64,
    /// What changed.
    pub(super) hypothesis: Hypothesis,
    /// Readings after the change relative to those before it, by axis.
    pub(super) factors: Vector3<f64>,
}

impl fmt::Display for SensorChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |axis: usize| ["x", "y", "z"][axis.min(2)];
        match self.hypothesis {
            Hypothesis::AxisGain(axis) if (self.factors[axis] + 1.0).abs() < MAX_SIGN_DEVIATION => {
                write!(f, "the sign of the sensor's {} axis changed", name(axis))?;
            }
            Hypothesis::AxisGain(axis) => {
                let factor = self.factors[axis];
                write!(f, "the gain of the sensor's {} axis changed by a factor of {factor:.2}", name(axis))?;
            }
            Hypothesis::Registers => {
                f.write_str("the sensor's gains and offset changed, as by a reset of its registers,")?;
            }
            _ => write!(f, "the sensor's gain changed by a factor of {:.2}", self.factors.x)?,
        }
        write!(f, " at {:.0} s: that is the sensor, not iron; no parameters fit both", self.time_s)
    }
}

/// Largest number of rows in a fit.
pub(super) const MAX_FITTED_ROWS: usize = 1200;
/// Least number of rows on a side.
pub(super) const MIN_ROWS_PER_SIDE: usize = 100;
/// Time on either side of a change that is not fitted, seconds: the rows are averages, and the time is uncertain.
pub(super) const SKIPPED_S: f64 = 0.5;
