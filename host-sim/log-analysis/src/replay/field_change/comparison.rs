//! Compares the hypotheses of a change at a time, by their evidence in Laplace's approximation (D. MacKay, "Bayesian
//! interpolation", 1992), with residuals that are correlated for seconds.

use autoswing::calibration::Solution;
use nalgebra::Vector3;

use super::candidates::{Candidate, MIN_ROWS_PER_SIDE};
use super::hard_iron_change::{HardIronChange, MIN_HEADING_EFFECT_DEG, heading_effect_deg};
use super::sensor_change::SensorChange;
use crate::log::FieldCorrection;
use crate::replay::change_fit::{ChangeFit, FitRow, Hypothesis, Scales};
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;
use crate::replay::rows;

/// Correlation time of the residuals, seconds: that of attitude errors.
const CORRELATION_S: f64 = 2.0;

/// Largest number of rows in a fit.
const MAX_FITTED_ROWS: usize = 1200;
/// Least number of rows on a side of a jump.
const MIN_ROWS_PER_SIDE_OF_JUMP: usize = 5;
/// Time on either side of a change that is not fitted, seconds: the rows are averages, and the time is uncertain.
pub(super) const SKIPPED_S: f64 = 0.5;

/// Largest expected error of a calibration that can show a change, degrees RMS: that of the module's acceptance.
const MAX_EXPECTED_ERROR_DEG: f32 = 3.0;

/// Least increase of the residuals of a fit to both sides, relative to the fits of each side, for a change.
const MIN_SCALE_RATIO: f64 = 1.1;

/// Smallest change of hard iron, microtesla; smaller ones hardly affect headings.
const MIN_CHANGE_UT: f64 = 1.0;

/// Smallest horizontal part of a change of hard iron, in its standard deviations. That the field changed at that time is
/// known from all three components.
const MIN_HORIZONTAL_SIGMAS: f64 = 6.0;
/// Least ratio of a side's residuals under the calibration of the other side to those with the change of hard iron.
const MIN_RESIDUAL_RATIO: f64 = 2.0;

/// Least evidence of a change of the sensor against none, natural logarithm of the ratio of probabilities.
const MIN_EVIDENCE_OF_SENSOR: f64 = 20.0;
/// Least evidence of hard iron against none: of a step, and of a jump, which may be along an axis that the rows do not observe.
const MIN_EVIDENCE_OF_STEP: f64 = 12.0;
const MIN_EVIDENCE_OF_JUMP: f64 = 3.0;
/// Least evidence of a change of the sensor against hard iron: of a gain of all axes; of an axis, which iron along that
/// axis resembles on a single heading; of registers, which include iron.
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
/// Largest gain that is one; the reciprocal of an axis that is stuck is larger.
const MAX_FACTOR: f64 = 20.0;

/// Gains from which a fit starts; those with the smallest objective are fitted.
const START_GAINS: [f64; 7] = [0.4, 0.6, 0.8, 1.0, 1.25, 1.7, 2.5];
const FITTED_STARTS: usize = 2;

/// Fits of all hypotheses to the rows on both sides of a time.
pub(super) struct Comparison {
    pub candidate: Candidate,
    sides: Sides,
    fits: Vec<FittedHypothesis>,
    /// Negative log-likelihood of the separate fits of both sides.
    separate_likelihood: f64,
    /// Smallest scales of all fits.
    scales: Scales,
}

/// A change of hard iron, the candidate that it was found by, and corrections before and after it.
pub(super) struct FoundChange {
    pub change: HardIronChange,
    /// Negative log-likelihood, with the least evidence that is sufficient; comparable between times.
    pub misfit: f64,
    pub candidate: Candidate,
    pub corrections: [FieldCorrection; 2],
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
    /// Estimate without a change, by the more accurate correction of one side.
    base: ChangeFit,
    /// Correction of the other side, whose readings a hypothesis transforms; none without a solution.
    other: Option<FieldCorrection>,
    /// Whether the estimate is an accurate fit to its side; a correction of other rows shows no change of the sensor.
    is_accurate: bool,
    /// Jump of the field in the readings of the changed side, if it jumps, and its standard deviation, microtesla.
    jump_ut: Option<(Vector3<f64>, f64)>,
    /// Number of successive rows with correlated residuals.
    correlated_rows: f64,
}

impl Sides {
    /// Rows before and after a time; none if rows are missing, or if there is neither an accurate fit to one side nor a
    /// correction that is `known` to fit one.
    fn new(rows: &[ReplayRow], Candidate { time_s, jump }: Candidate, known: Option<&FieldCorrection>) -> Option<Self> {
        let stride = rows.len().div_ceil(MAX_FITTED_ROWS).max(1);
        let correlated_rows = (CORRELATION_S / (rows::median_step_s(rows)? * stride as f64)).max(1.0);
        let before = &rows[..rows.partition_point(|row| row.t_s < time_s - SKIPPED_S)];
        let after = &rows[rows.partition_point(|row| row.t_s <= time_s + SKIPPED_S)..];
        let min_rows = jump.map_or(MIN_ROWS_PER_SIDE, |_| MIN_ROWS_PER_SIDE_OF_JUMP);
        if before.len().min(after.len()) < min_rows {
            return None;
        }
        let solutions = [before, after].map(solve_all_rows);
        let [error_before_deg, error_after_deg] =
            solutions.each_ref().map(|solution| expected_error_deg(solution.as_ref()));
        let fits = solutions.map(|solution| solution.as_ref().map(solved_correction));
        let is_accurate = error_before_deg.min(error_after_deg) <= MAX_EXPECTED_ERROR_DEG;
        let (correction, other, is_later_changed) = if is_accurate && error_before_deg <= error_after_deg {
            (fits[0]?, fits[1], true)
        } else if is_accurate {
            (fits[1]?, fits[0], false)
        } else {
            (*known?, None, scatter_ut(before, known?) <= scatter_ut(after, known?))
        };
        let thinned = |side: &[ReplayRow], is_changed| -> Vec<FitRow> {
            side.iter().step_by(stride).map(|row| FitRow::new(row, is_changed)).collect()
        };
        let rows = [thinned(before, !is_later_changed), thinned(after, is_later_changed)].concat();
        let base = ChangeFit::from_correction(&rows, &correction);
        let sign = change_sign(is_later_changed);
        let jump_ut = jump.map(|jump| (jump.step_ut * sign, jump.sigma_ut));
        Some(Self { rows, is_later_changed, base, other, is_accurate, jump_ut, correlated_rows })
    }

    /// Best fit of a hypothesis from several starts.
    fn fitted(&self, hypothesis: Hypothesis) -> ChangeFit {
        self.fitted_from(self.starts_of(hypothesis), hypothesis)
    }

    /// Best fit of hard iron of the size of the jump, if the field jumps.
    fn fitted_to_jump(&self) -> Option<ChangeFit> {
        let jump = self.jump_ut?;
        let of_jump = self.base.with_change(Vector3::repeat(1.0), jump.0);
        let starts = self.starts_of(Hypothesis::HardIron).into_iter().chain([of_jump]);
        Some(self.fitted_from(starts.map(|start| start.with_measured_offset(jump)).collect(), Hypothesis::HardIron))
    }

    fn fitted_from(&self, mut starts: Vec<ChangeFit>, hypothesis: Hypothesis) -> ChangeFit {
        let objective = |fit: &ChangeFit| fit.objective(&self.rows);
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

    /// Fits of the hypotheses; none if no change is apparent, and the field does not jump. The axes are not compared if hard
    /// iron fits as well as separate fits of both sides.
    fn fitted_hypotheses(&self, separate: &[ChangeFit; 2]) -> Option<Vec<(Hypothesis, ChangeFit)>> {
        let rows = &self.rows;
        let unchanged = self.fitted(Hypothesis::Unchanged);
        let mut scales = unchanged.scales_ut(rows).into_iter().zip(combined_scales(rows, separate));
        if self.jump_ut.is_none() && scales.all(|(scale, separate)| scale <= MIN_SCALE_RATIO * separate) {
            return None;
        }
        let iron = self.fitted(Hypothesis::HardIron);
        let limit = combined_objective(rows, separate) + MAX_IRON_MISFIT * rows.len() as f64;
        let is_iron = is_balanced(rows, &iron) && iron.objective(rows) < limit;
        let of_axes: &[Hypothesis] = if is_iron || !self.is_accurate { &[] } else { &Hypothesis::OF_AXES };
        let of_all: &[Hypothesis] = if self.is_accurate { &[Hypothesis::Gain] } else { &[] };
        let of_sensor = of_all.iter().chain(of_axes).map(|&hypothesis| (hypothesis, self.fitted(hypothesis)));
        let of_jump = self.fitted_to_jump().map(|fit| (Hypothesis::HardIron, fit));
        let of_iron = [(Hypothesis::Unchanged, unchanged), (Hypothesis::HardIron, iron)];
        Some(of_iron.into_iter().chain(of_jump).chain(of_sensor).collect())
    }
}

/// Median deviation of strength and vertical component from their own medians by a correction, microtesla.
fn scatter_ut(rows: &[ReplayRow], correction: &FieldCorrection) -> f64 {
    let rows: Vec<FitRow> = rows.iter().map(|row| FitRow::new(row, false)).collect();
    ChangeFit::from_correction(&rows, correction).scatter_ut(&rows)
}

/// Expected error of a solution, degrees RMS. Zero is that of a degenerate solution.
fn expected_error_deg(solution: Option<&Solution>) -> f32 {
    let error_deg = solution.map(|solution| solution.quality.expected_rms_deg);
    error_deg.filter(|error_deg| *error_deg > 0.0).unwrap_or(f32::INFINITY)
}

impl Comparison {
    /// Fits the hypotheses; none if rows or a fit are missing, or no change is apparent.
    pub fn new(rows: &[ReplayRow], candidate: Candidate, known: Option<&FieldCorrection>) -> Option<Self> {
        let sides = Sides::new(rows, candidate, known)?;
        let rows = &sides.rows;
        let separate = sides.base.fitted_separately(rows, sides.other.as_ref());
        let fits = sides.fitted_hypotheses(&separate)?;
        let scales = fits
            .iter()
            .map(|(_, fit)| fit.scales_ut(rows))
            .fold(combined_scales(rows, &separate), |smallest, scales| {
                std::array::from_fn(|group| smallest[group].min(scales[group]))
            });
        let separate_likelihood =
            [0, 1].map(|side| separate[side].negative_log_likelihood(&rows_of_side(rows, side), &scales)).iter().sum();
        let with_evidence = |(hypothesis, fit): (Hypothesis, ChangeFit)| FittedHypothesis {
            hypothesis,
            fit,
            negative_log_evidence: fit.negative_log_evidence(rows, hypothesis, &scales, sides.correlated_rows),
        };
        let fits = fits.into_iter().map(with_evidence).collect();
        Some(Self { candidate, sides, fits, separate_likelihood, scales })
    }

    /// Objective of the best hypothesis per row, comparable between times.
    pub fn mean_objective(&self) -> f64 {
        let objectives =
            self.fits.iter().map(|fitted| fitted.fit.objective(&self.sides.rows) / self.sides.rows.len() as f64);
        objectives.fold(f64::INFINITY, f64::min)
    }

    fn fit_of(&self, hypothesis: Hypothesis) -> Option<&FittedHypothesis> {
        self.best_fit(|other| other == hypothesis)
    }

    /// The most probable of some hypotheses.
    fn best_fit(&self, is_candidate: impl Fn(Hypothesis) -> bool) -> Option<&FittedHypothesis> {
        let fits = self.fits.iter().filter(|fitted| is_candidate(fitted.hypothesis));
        fits.min_by(|a, b| a.negative_log_evidence.total_cmp(&b.negative_log_evidence))
    }

    /// Whether this compares a step at that time with no change.
    pub fn is_of_step_at(&self, time_s: f64) -> bool {
        self.candidate.jump.is_none() && self.candidate.time_s.to_bits() == time_s.to_bits()
    }

    /// The comparison at the time that divides the rows best into unchanged and changed ones by the most probable change; none
    /// if a step then is compared already. A jump has its own time.
    pub fn refined(
        self,
        rows: &[ReplayRow],
        known: Option<&FieldCorrection>,
        is_compared: impl Fn(f64) -> bool,
    ) -> Option<Self> {
        let earlier: Vec<FitRow> = rows.iter().map(|row| FitRow::new(row, !self.sides.is_later_changed)).collect();
        let best = self.best_fit(|hypothesis| hypothesis != Hypothesis::Unchanged)?;
        let index = best.fit.likeliest_division(&earlier, &self.scales, 0)?;
        let candidate = Candidate { time_s: rows.get(index)?.t_s, ..self.candidate };
        if (candidate.time_s - self.candidate.time_s).abs() < SKIPPED_S {
            Some(Self { candidate, ..self })
        } else if candidate.jump.is_some() {
            Some(self)
        } else if is_compared(candidate.time_s) {
            None
        } else {
            Self::new(rows, candidate, known)
        }
    }

    /// The change of hard iron, if that is evident and affects headings. Horizontal components only: on a single heading the
    /// component across it is hardly observable, and a vertical component changes no heading.
    pub fn hard_iron_change(&self) -> Option<FoundChange> {
        let Sides { rows, base, is_later_changed, correlated_rows, .. } = &self.sides;
        let unchanged = self.fit_of(Hypothesis::Unchanged)?;
        let of_iron = self.fits.iter().filter(|fitted| fitted.hypothesis == Hypothesis::HardIron);
        let with_excess = of_iron.map(|iron| {
            let min_evidence = if iron.fit.is_measured() { MIN_EVIDENCE_OF_JUMP } else { MIN_EVIDENCE_OF_STEP };
            (iron, min_evidence, unchanged.negative_log_evidence - iron.negative_log_evidence - min_evidence)
        });
        let (iron, min_evidence, excess) = with_excess.max_by(|(.., a), (.., b)| a.total_cmp(b))?;
        let misfit = iron.fit.objective(rows) / correlated_rows + min_evidence;
        let changed_side = rows_of_side(rows, 1);
        let with_change = base.with_change(Vector3::repeat(1.0), iron.fit.offset_ut);
        let residual_ratio = base.scatter_ut(&changed_side) / with_change.scatter_ut(&changed_side);
        let is_evident = excess > 0.0 && (iron.fit.is_measured() || residual_ratio > MIN_RESIDUAL_RATIO);
        let sigma_ut = iron.fit.offset_sigma_ut(rows, *correlated_rows)?;
        let change_ut = iron.fit.corrected_offset_ut();
        let heading_effect_deg = heading_effect_deg(change_ut, iron.fit.horizontal_ut());
        let is_significant = change_ut.xy().norm() > MIN_HORIZONTAL_SIGMAS * sigma_ut.xy().norm();
        if !is_evident
            || !is_significant
            || iron.fit.offset_ut.norm() < MIN_CHANGE_UT
            || heading_effect_deg < MIN_HEADING_EFFECT_DEG
        {
            return None;
        }
        let mut corrections = iron.fit.corrections_of_sides();
        if !is_later_changed {
            corrections.reverse();
        }
        let step_ut = iron.fit.offset_ut * change_sign(*is_later_changed);
        let change = HardIronChange { time_s: self.candidate.time_s, step_ut, sigma_ut, heading_effect_deg };
        Some(FoundChange { change, misfit, candidate: self.candidate, corrections })
    }

    /// The change of the sensor, if there is sufficient evidence.
    pub fn sensor_change(&self) -> Option<SensorChange> {
        let best = self.best_fit(Hypothesis::is_of_sensor)?;
        let [unchanged, iron] = [self.fit_of(Hypothesis::Unchanged)?, self.fit_of(Hypothesis::HardIron)?];
        let evidence = |other: &FittedHypothesis| other.negative_log_evidence - best.negative_log_evidence;
        let min_against_iron = match best.hypothesis {
            Hypothesis::Registers => MIN_EVIDENCE_OF_REGISTERS,
            Hypothesis::AxisGain(_) => MIN_EVIDENCE_OF_AXIS_GAIN,
            _ => MIN_EVIDENCE_OF_GAIN,
        };
        let is_evident = evidence(unchanged) > MIN_EVIDENCE_OF_SENSOR
            && evidence(iron) > min_against_iron
            && self.is_fitted(&best.fit, &unchanged.fit)
            && (best.hypothesis != Hypothesis::Registers || !is_balanced(&self.sides.rows, &iron.fit));
        let factors = self.factors(&best.fit);
        (is_evident && is_large(best.hypothesis, &factors)).then_some(SensorChange {
            time_s: self.candidate.time_s,
            hypothesis: best.hypothesis,
            factors,
        })
    }

    /// Whether a hypothesis explains most of the misfit, and fits both sides equally well.
    fn is_fitted(&self, fit: &ChangeFit, unchanged: &ChangeFit) -> bool {
        let misfit =
            |fit: &ChangeFit| fit.negative_log_likelihood(&self.sides.rows, &self.scales) - self.separate_likelihood;
        is_balanced(&self.sides.rows, fit) && misfit(fit) < MAX_REMAINING_MISFIT * misfit(unchanged)
    }

    /// Ratios of the readings after the change to those before it, by axis.
    fn factors(&self, fit: &ChangeFit) -> Vector3<f64> {
        if self.sides.is_later_changed { fit.gain.map(f64::recip) } else { fit.gain }
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

/// Sign of the step in time by the offset of the changed side.
const fn change_sign(is_later_changed: bool) -> f64 {
    if is_later_changed { 1.0 } else { -1.0 }
}
