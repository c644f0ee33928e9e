//! Fits for the parameters of an autopilot: to the rows flown since the last change, and to two halves of them for
//! cross-validation.

use autoswing::calibration::{Orientation, Solution, SolveError};
use autoswing_module::messages::Refusal;

use super::replay_run::solve_rows;
use crate::replay::result::ReplayOptions;
use crate::replay::row::ReplayRow;

/// Duration of the blocks of rows that are fitted or held back together, seconds: longer than the correlation of
/// attitude errors.
const FIT_BLOCK_S: f64 = 10.0;

/// Time after a change that is not fitted, seconds: the time of a step is uncertain by a few rows.
const SKIPPED_AFTER_CHANGE_S: f64 = 1.0;

/// Fits to the rows since the last change of hard iron or mounting.
#[derive(Clone, Debug)]
pub struct ParameterFit {
    /// Time of the last change, seconds; none without a change.
    pub last_change_s: Option<f64>,
    /// First and last usable row fitted, seconds; none without usable rows.
    pub fitted_range_s: Option<[f64; 2]>,
    /// Fit without the current, and one with it if it estimates motor-current interference.
    pub fit_variants: Vec<FitVariant>,
}

/// Fits of one set of unknowns: to all rows, and to each half.
#[derive(Clone, Debug)]
pub struct FitVariant {
    /// Fit to all rows.
    pub fit_of_all_rows: Solution,
    /// Whether the module's verification accepts the fit.
    pub is_accepted: bool,
    /// Right-angle mounting of the sensor against that of the log.
    pub mount: Orientation,
    /// Fits to the first and to the second half of the rows; none for a half without a solution.
    pub fits_of_halves: [Option<Solution>; 2],
}

impl ParameterFit {
    /// Fits the rows after the last change.
    #[must_use]
    pub fn new(rows: &[ReplayRow], changed_s: Option<f64>, options: &ReplayOptions) -> Self {
        let from_s = changed_s.map_or(f64::NEG_INFINITY, |at_s| at_s + SKIPPED_AFTER_CHANGE_S);
        let since: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable && row.t_s >= from_s).copied().collect();
        let without_current: Vec<ReplayRow> = since.iter().map(|row| ReplayRow { current_a: None, ..*row }).collect();
        let with = FitVariant::new(&since, options);
        let is_by_current =
            |fit_variant: &FitVariant| fit_variant.fit_of_all_rows.calibration.motor_current.is_applied();
        let variants = match with.filter(is_by_current) {
            Some(with) => FitVariant::new(&without_current, options).into_iter().chain([with]).collect(),
            None => FitVariant::new(&without_current, options).into_iter().collect(),
        };
        Self {
            last_change_s: changed_s,
            fitted_range_s: since.first().zip(since.last()).map(|(first, last)| [first.t_s, last.t_s]),
            fit_variants: variants,
        }
    }

    /// Rows to which the parameters are fitted.
    pub fn fitted_rows<'a>(&self, rows: &'a [ReplayRow]) -> impl Iterator<Item = &'a ReplayRow> + use<'a> {
        let [from_s, to_s] = self.fitted_range_s.unwrap_or([f64::INFINITY; 2]);
        rows.iter().filter(move |row| row.is_usable && (from_s..=to_s).contains(&row.t_s))
    }
}

impl FitVariant {
    fn new(rows: &[ReplayRow], options: &ReplayOptions) -> Option<Self> {
        let (mount, (solution, acceptance)) = solve_in_any_mount(rows, options, Orientation::IDENTITY_ROTATION);
        let rows_of_half = |half_index: usize| -> Vec<ReplayRow> {
            rows.iter().filter(|row| half_index_at(row.t_s) == half_index).copied().collect()
        };
        Some(Self {
            fit_of_all_rows: solution?,
            is_accepted: acceptance.is_ok(),
            mount,
            fits_of_halves: [0, 1].map(|half| solve_in_any_mount(&rows_of_half(half), options, mount).1.0),
        })
    }
}

/// Solves rows in a mounting, or in that which they contradict it with. Noise can imitate a mounting, which is then not
/// accepted.
fn solve_in_any_mount(
    rows: &[ReplayRow],
    options: &ReplayOptions,
    mount: Orientation,
) -> (Orientation, (Option<Solution>, Result<(), Refusal>)) {
    let outcome = solve_rows(rows, options, mount);
    if let Err(Refusal::Solve(SolveError::MountContradicted { found })) = outcome.1 {
        let turned = solve_rows(rows, options, found);
        if turned.1.is_ok() {
            return (found, turned);
        }
    }
    (mount, outcome)
}

/// Half of the flight that a time belongs to: blocks alternate irregularly (by the golden ratio), so that circles of
/// any period are divided evenly.
#[must_use]
pub fn half_index_at(t_s: f64) -> usize {
    const GOLDEN_RATIO: f64 = 0.618_033_988_749_895;
    usize::from(((t_s / FIT_BLOCK_S).floor() * GOLDEN_RATIO).rem_euclid(1.0) < 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::RowSelection;
    use crate::replay::tests::level_row;

    /// The second after a change is skipped.
    #[test]
    fn usable_rows_since_the_last_change_are_fitted() {
        let mut rows: Vec<ReplayRow> = (0..40).map(|i| level_row(f64::from(i) / 2.0, 0.0)).collect();
        (rows[13].is_usable, rows[30].is_usable, rows[39].is_usable) = (false, false, false);
        let options = ReplayOptions::with_selection(RowSelection::All);
        for (changed_s, first, fitted_count) in [(None, 0, 37), (Some(5.6), 14, 24)] {
            let fit = ParameterFit::new(&rows, changed_s, &options);
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
