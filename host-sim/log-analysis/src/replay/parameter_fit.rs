//! The fit of a compass: to the rows flown since the last change. Fits to two halves of them cross-validate parameters.

use autoswing::calibration::{Orientation, Solution, SolveError};
use autoswing_module::messages::Refusal;
use nalgebra::Vector3;

use super::replay_run::solve_rows;
use super::row_solve::{is_determined, solved_correction};
use crate::log::FieldCorrection;
use crate::replay::result::{CalibrationOutcome, EarthFieldPrior};
use crate::replay::row::ReplayRow;

/// Duration of the blocks of rows that are fitted or held back together, seconds: longer than the correlation of
/// attitude errors.
const FIT_BLOCK_S: f64 = 10.0;

/// Time after a change that is not fitted, seconds: the time of a step is uncertain by a few rows.
const SKIPPED_AFTER_CHANGE_S: f64 = 1.0;

/// Minimum of the largest component of motor-current interference that is fitted, standard deviations.
const MIN_MOTOR_SIGNIFICANCE: f32 = 3.0;
/// Minimum effect on headings of motor-current interference that is fitted, degrees RMS.
const MIN_MOTOR_EFFECT_DEG: f32 = 0.2;

/// Fit to the rows since the last change of hard iron or mounting.
#[derive(Clone, Debug)]
pub struct ParameterFit {
    /// Time of the last change, seconds; none without a change.
    pub last_change_s: Option<f64>,
    /// First and last usable row fitted, seconds; none without usable rows.
    pub fitted_range_s: Option<[f64; 2]>,
    /// The fit; none without a solution.
    pub fit: Option<CompassFit>,
}

/// A fit by the module's solver.
#[derive(Clone, Debug)]
pub struct CompassFit {
    /// Solution of all rows.
    pub solution: Solution,
    /// Whether the module's verification accepts the fit.
    pub is_accepted: bool,
    /// Right-angle mounting of the sensor against that of the log.
    pub mount: Orientation,
    prior: EarthFieldPrior,
}

impl ParameterFit {
    /// Fits the rows after the last change.
    pub fn new(rows: &[ReplayRow], changed_s: Option<f64>, prior: &EarthFieldPrior) -> Self {
        let from_s = changed_s.map_or(f64::NEG_INFINITY, |at_s| at_s + SKIPPED_AFTER_CHANGE_S);
        let since: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable && row.t_s >= from_s).copied().collect();
        Self {
            last_change_s: changed_s,
            fitted_range_s: since.first().zip(since.last()).map(|(first, last)| [first.t_s, last.t_s]),
            fit: CompassFit::new(&since, prior),
        }
    }

    /// Rows to which the parameters are fitted.
    pub fn fitted_rows<'a>(&self, rows: &'a [ReplayRow]) -> impl Iterator<Item = &'a ReplayRow> + use<'a> {
        let [from_s, to_s] = self.fitted_range_s.unwrap_or([f64::INFINITY; 2]);
        rows.iter().filter(move |row| row.is_usable && (from_s..=to_s).contains(&row.t_s))
    }

    /// Solution of the fit.
    pub fn solution(&self) -> Option<&Solution> {
        self.fit.as_ref().map(|fit| &fit.solution)
    }

    /// Correction by the fit.
    pub fn correction(&self) -> Option<FieldCorrection> {
        self.solution().map(solved_correction)
    }

    /// Strength of the Earth's field by a fit that the flight determines, microtesla.
    pub fn strength_ut(&self) -> Option<f64> {
        self.solution().filter(|solution| is_determined(solution)).map(|solution| solution.calibration.total_ut.into())
    }
}

impl CompassFit {
    /// Fits the rows, with motor-current interference if that is known and large enough to matter.
    fn new(rows: &[ReplayRow], prior: &EarthFieldPrior) -> Option<Self> {
        let fit = Self::in_any_mount(rows, prior, Orientation::IDENTITY_ROTATION)?;
        if fit.has_motor_current() && !is_motor_significant(&fit.solution) {
            fit.without_current(rows)
        } else {
            Some(fit)
        }
    }

    fn in_any_mount(rows: &[ReplayRow], prior: &EarthFieldPrior, mount: Orientation) -> Option<Self> {
        let (mount, outcome) = solve_in_any_mount(rows, prior, mount);
        Some(Self { solution: outcome.solution?, is_accepted: outcome.acceptance.is_ok(), mount, prior: *prior })
    }

    /// Whether the fit estimates motor-current interference.
    pub(super) fn has_motor_current(&self) -> bool {
        self.solution.calibration.motor_current.is_applied()
    }

    /// The fit of the rows without their current.
    pub(super) fn without_current(&self, rows: &[ReplayRow]) -> Option<Self> {
        let without_current: Vec<ReplayRow> = rows.iter().map(|row| ReplayRow { current_a: None, ..*row }).collect();
        Self::in_any_mount(&without_current, &self.prior, Orientation::IDENTITY_ROTATION)
    }

    /// Fits of the same unknowns to the first and to the second half of the rows; none for a half without a solution.
    pub(super) fn fits_of_halves(&self, rows: &[ReplayRow]) -> [Option<Solution>; 2] {
        let fit_half = |half_index: usize| {
            let rows_of_half = rows.iter().filter(|row| half_index_at(row.t_s) == half_index);
            let with_unknowns =
                |row: &ReplayRow| ReplayRow { current_a: row.current_a.filter(|_| self.has_motor_current()), ..*row };
            let half: Vec<ReplayRow> = rows_of_half.map(with_unknowns).collect();
            solve_in_any_mount(&half, &self.prior, self.mount).1.solution
        };
        rayon::join(|| fit_half(0), || fit_half(1)).into()
    }
}

/// Whether motor-current interference is known and large enough to be compensated.
fn is_motor_significant(solution: &Solution) -> bool {
    let calibration = &solution.calibration;
    let motor = &calibration.motor_current;
    let ut_per_a = Vector3::from(motor.ut_per_a);
    let horizontal_ut = calibration.total_ut * libm::cosf(calibration.inclination_rad);
    let effect_deg = (ut_per_a.norm() * motor.current_sigma_a / horizontal_ut).to_degrees();
    ut_per_a.amax() >= MIN_MOTOR_SIGNIFICANCE * motor.sigma_ut_per_a && effect_deg >= MIN_MOTOR_EFFECT_DEG
}

/// Solves rows in a mounting, or in that which they contradict it with. Noise can imitate a mounting, which is then not
/// accepted.
fn solve_in_any_mount(
    rows: &[ReplayRow],
    prior: &EarthFieldPrior,
    mount: Orientation,
) -> (Orientation, CalibrationOutcome) {
    let outcome = solve_rows(rows, prior, mount);
    if let Err(Refusal::Solve(SolveError::MountContradicted { found })) = outcome.acceptance {
        let turned = solve_rows(rows, prior, found);
        if turned.acceptance.is_ok() {
            return (found, turned);
        }
    }
    (mount, outcome)
}

/// Half of the flight that a time belongs to: blocks alternate irregularly (by the golden ratio), so that circles of
/// any period are divided evenly.
pub fn half_index_at(t_s: f64) -> usize {
    const GOLDEN_RATIO: f64 = 0.618_033_988_749_895;
    usize::from(((t_s / FIT_BLOCK_S).floor() * GOLDEN_RATIO).rem_euclid(1.0) < 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::tests::level_row;

    /// The second after a change is skipped.
    #[test]
    fn usable_rows_since_the_last_change_are_fitted() {
        let mut rows: Vec<ReplayRow> = (0..40).map(|i| level_row(f64::from(i) / 2.0, 0.0)).collect();
        (rows[13].is_usable, rows[30].is_usable, rows[39].is_usable) = (false, false, false);
        let prior = EarthFieldPrior::default();
        for (changed_s, first, fitted_count) in [(None, 0, 37), (Some(5.6), 14, 24)] {
            let fit = ParameterFit::new(&rows, changed_s, &prior);
            assert_eq!(fit.fitted_range_s, Some([f64::from(first) / 2.0, 19.0]));
            assert!(fit.fitted_rows(&rows).all(|row| row.is_usable));
            assert_eq!(fit.fitted_rows(&rows).count(), fitted_count);
        }
    }

    /// A block of 10 s is not divided, since its noise is correlated. A circle of 20 s is two blocks: regular alternation
    /// would give each half one half of every circle.
    #[test]
    fn both_halves_contain_every_phase_of_a_circle() {
        for period_s in [20, 40, 60] {
            for phase_s in (0..period_s).step_by(10) {
                let half_at = |circle: i32, t_s: f64| half_index_at(f64::from(circle * period_s + phase_s) + t_s);
                assert!(
                    (0..20).all(|circle| half_at(circle, 0.0) == half_at(circle, 9.9)),
                    "{period_s} s, {phase_s} s"
                );
                let second_half_count = (0..20).map(|circle| half_at(circle, 5.0)).sum::<usize>();
                assert!((4..=16).contains(&second_half_count), "{period_s} s, {phase_s} s: {second_half_count} of 20");
            }
        }
    }
}
