//! Iron that changed in flight: when, by how much, on which axis.
//!
//! Corrected fields `h = W (m - b)` of constant iron have one strength `F` and one vertical component `F sin I` when levelled.
//! Both residuals of every row are made linear about a solution, with `W`, `b`, `F` and `I` as unknowns, and with three more:
//! a step of `b` at an instant. The instant that explains most is the one; each one's normal equations are sums over the rows
//! after it, so all are had in one pass. More passes with the step taken out settle size and instant.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::Row;
use super::judge::median;
use crate::log::Iron;

/// Unknowns: `W` row by row, `b`, strength, vertical component; then the step.
const COMMON: usize = 14;
const ALL: usize = COMMON + 3;

/// Instants that are tried, and rows of either side that it takes.
const INSTANTS: usize = 120;
const MIN_ROWS: usize = 60;

/// Rows that are looked at: more than that tell no more.
const MAX_ROWS: usize = 4000;

/// A change is one when it is so many of its sigmas, so strong (microtesla), and leaves no more than this of the scatter of all
/// rows.
const MIN_SIGMAS: f64 = 8.0;
const MIN_UT: f64 = 1.0;
const MAX_SCATTER_LEFT: f64 = 0.85;

/// Or, where the rows on its shorter side are too few to show in that, no more than the first of their scatter, and no more than
/// the second of that of all rows.
/// VTOLs that first hover, or hover at last, would have steps of 1 to 4 uT there that make all other rows worse.
const MAX_LEFT_OF_FEW: f64 = 0.6;
const MAX_LEFT_WITH_FEW: f64 = 0.97;

/// So many neighbouring rows err alike: those of a second or so.
const ALIKE: f64 = 10.0;

/// Passes at the most, and what a pass may still move the step by, sigmas, when the search has settled. Where the two irons are
/// far apart residuals are clipped, and each pass goes a part of the way: a dozen are needed, and four told half of a step.
const PASSES: usize = 40;
const SETTLED_SIGMAS: f64 = 0.1;

/// Residuals beyond so many of their scale count as that.
const CLIP: f64 = 3.0;

/// A step of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// When, seconds on the flight's time line.
    pub at_s: f64,
    /// By how much, body axes, microtesla.
    pub ut: [f64; 3],
    /// Its standard deviation, axis by axis.
    pub sigma_ut: [f64; 3],
}

impl Change {
    /// Its size, microtesla.
    #[must_use]
    pub fn size_ut(&self) -> f64 {
        Vector3::from(self.ut).norm()
    }

    /// The axis that it is most on.
    #[must_use]
    pub fn axis(&self) -> char {
        ['x', 'y', 'z'][Vector3::from(self.ut).iamax()]
    }
}

/// The step of the iron that the usable rows show, about a correction that holds for most of them; none if they show none.
#[must_use]
pub fn found(rows: &[Row], about: &Iron) -> Option<Change> {
    let usable: Vec<&Row> = rows.iter().filter(|row| row.usable).collect();
    let every = usable.len().div_ceil(MAX_ROWS).max(1);
    let usable: Vec<&Row> = usable.into_iter().step_by(every).collect();
    if usable.len() < 2 * MIN_ROWS {
        return None;
    }
    let without = State::about(&usable, about);
    let mut state = without.clone();
    let mut change = None;
    for _ in 0..PASSES {
        let (before, told) = (state.moved, change.map(|(first, _)| first));
        let (first, sigma) = state.step(&usable, told)?;
        change = Some((state.parted(&usable).unwrap_or(first), sigma));
        let is_settled = (state.moved - before).component_div(&sigma).amax() < SETTLED_SIGMAS;
        if is_settled && change.map(|(first, _)| first) == told {
            break;
        }
    }
    let (first, sigma) = change?;
    let left = |rows: &[&Row], first| state.scatter(rows, Some(first)) / without.scatter(rows, None);
    let (before, after) = usable.split_at(first);
    let left_of_few = if after.len() < before.len() { left(after, 0) } else { left(before, before.len()) };
    let left_of_all = left(&usable, first);
    let is_better = left_of_all < MAX_SCATTER_LEFT || left_of_all < MAX_LEFT_WITH_FEW && left_of_few < MAX_LEFT_OF_FEW;
    let found = Change { at_s: usable[first].t_s, ut: state.moved.into(), sigma_ut: sigma.into() };
    let sigmas = state.moved.component_div(&sigma).amax();
    (sigmas > MIN_SIGMAS && found.size_ut() > MIN_UT && is_better).then_some(found)
}

/// Where the search stands.
#[derive(Clone)]
struct State {
    matrix: Matrix3<f64>,
    centre: Vector3<f64>,
    strength: f64,
    down: f64,
    by_current: Vector3<f64>,
    moved: Vector3<f64>,
}

impl State {
    fn about(rows: &[&Row], iron: &Iron) -> Self {
        let of = |row: &&Row| row.corrected(iron);
        let strength = median(rows.iter().map(|row| of(row).norm()).collect());
        let down = median(rows.iter().map(|row| down(row).dot(&of(row))).collect());
        Self {
            matrix: iron.matrix,
            centre: iron.centre_ut,
            strength,
            down,
            by_current: iron.by_current_ut,
            moved: Vector3::zeros(),
        }
    }

    fn off_centre(&self, row: &Row) -> Vector3<f64> {
        row.field.ut.map(f64::from) - self.centre - self.by_current * row.current_a.map_or(0.0, f64::from)
    }

    /// Corrected field of a row, from the step on or before it.
    fn field(&self, row: &Row, is_after: bool) -> Vector3<f64> {
        let moved = if is_after { self.moved } else { Vector3::zeros() };
        self.matrix * (self.off_centre(row) - moved)
    }

    fn residuals(&self, row: &Row, is_after: bool) -> [f64; 2] {
        let field = self.field(row, is_after);
        [field.norm() - self.strength, down(row).dot(&field) - self.down]
    }

    fn scatter(&self, rows: &[&Row], first: Option<usize>) -> f64 {
        let all =
            rows.iter().enumerate().flat_map(|(i, row)| self.residuals(row, first.is_some_and(|first| i >= first)));
        median(all.map(f64::abs).collect())
    }

    /// A step of the search; the first row after the change, sought or as told, and the sigma of its size.
    fn step(&mut self, rows: &[&Row], told: Option<usize>) -> Option<(usize, Vector3<f64>)> {
        let scale = (1.4826 * self.scatter(rows, told)).max(1e-6);
        // Sums over the rows from each instant on; the last is of all rows.
        let instants: Vec<usize> = (1..=INSTANTS).map(|i| rows.len() * i / (INSTANTS + 1)).collect();
        let mut sums: Vec<(usize, DMatrix<f64>, DVector<f64>)> = Vec::new();
        let (mut matrix, mut right) = (DMatrix::zeros(COMMON, COMMON), DVector::zeros(COMMON));
        let mut squares = 0.0;
        for (i, row) in rows.iter().enumerate().rev() {
            let is_after = told.is_some_and(|first| i >= first);
            for (residual, by) in self.residuals(row, is_after).into_iter().zip(self.derivatives(row, is_after)) {
                let clipped = residual.clamp(-CLIP * scale, CLIP * scale);
                squares += clipped * clipped;
                matrix.ger(1.0, &by, &by, 1.0);
                right.axpy(-clipped, &by, 1.0);
            }
            let is_tried = told.map_or_else(|| instants.contains(&i), |first| first == i);
            if is_tried && i >= MIN_ROWS && rows.len() - i >= MIN_ROWS {
                sums.push((i, matrix.clone(), right.clone()));
            }
        }
        let best = sums
            .iter()
            .filter_map(|(i, after, after_right)| {
                let (solved, gain, sigma) = solved(&matrix, &right, after, after_right, &self.scales())?;
                Some((*i, solved, gain, sigma))
            })
            .max_by(|(_, _, a, _), (_, _, b, _)| a.total_cmp(b))?;
        let (first, solved, _, sigma) = best;
        for row in 0..3 {
            for column in 0..3 {
                self.matrix[(row, column)] += solved[3 * row + column];
            }
        }
        let of = |from: usize| Vector3::new(solved[from], solved[from + 1], solved[from + 2]);
        self.centre += of(9);
        self.strength += solved[12];
        self.down += solved[13];
        self.moved += of(COMMON);
        let variance = squares / (2.0 * rows.len() as f64);
        Some((first, sigma * (variance * ALIKE).sqrt()))
    }

    /// The first row after the change, where the two irons explain most with what they are by now.
    fn parted(&self, rows: &[&Row]) -> Option<usize> {
        let scale = 1.4826 * self.scatter(rows, None);
        let squares = |row: &Row, is_after: bool| -> f64 {
            self.residuals(row, is_after)
                .iter()
                .map(|residual| residual.clamp(-CLIP * scale, CLIP * scale).powi(2))
                .sum()
        };
        // What is saved by taking the row for one before the change, summed up from the beginning.
        let mut saved = 0.0;
        let sums: Vec<f64> = rows
            .iter()
            .map(|row| {
                saved += squares(row, false) - squares(row, true);
                saved
            })
            .collect();
        (MIN_ROWS..rows.len().saturating_sub(MIN_ROWS)).min_by(|a, b| sums[a - 1].total_cmp(&sums[b - 1]))
    }

    /// Each residual by the unknowns.
    fn derivatives(&self, row: &Row, is_after: bool) -> [DVector<f64>; 2] {
        let moved = if is_after { self.moved } else { Vector3::zeros() };
        let raw = self.off_centre(row) - moved;
        let field = self.matrix * raw;
        let directions = [field.normalize(), down(row)];
        let of = |which: usize| {
            let direction = directions[which];
            let mut by = DVector::zeros(COMMON);
            for i in 0..3 {
                for j in 0..3 {
                    by[3 * i + j] = direction[i] * raw[j];
                }
            }
            let by_centre = -(self.matrix.transpose() * direction);
            by.rows_mut(9, 3).copy_from(&by_centre);
            by[12 + which] = -1.0;
            by
        };
        [of(0), of(1)]
    }

    /// How far each unknown may move, which keeps those that nothing tells of where they are.
    fn scales(&self) -> [f64; ALL] {
        std::array::from_fn(|i| match i {
            0..9 => 0.3,
            12 => 1e-3,
            _ => self.strength,
        })
    }
}

/// The unknowns, how much they explain beyond what is explained without the step, and the root of the step's covariance.
fn solved(
    matrix: &DMatrix<f64>,
    right: &DVector<f64>,
    after: &DMatrix<f64>,
    after_right: &DVector<f64>,
    scales: &[f64; ALL],
) -> Option<(DVector<f64>, f64, Vector3<f64>)> {
    let mut all = DMatrix::zeros(ALL, ALL);
    all.view_mut((0, 0), (COMMON, COMMON)).copy_from(matrix);
    let step = after.view((0, 9), (COMMON, 3)).into_owned();
    all.view_mut((0, COMMON), (COMMON, 3)).copy_from(&step);
    all.view_mut((COMMON, 0), (3, COMMON)).copy_from(&step.transpose());
    all.view_mut((COMMON, COMMON), (3, 3)).copy_from(&after.view((9, 9), (3, 3)));
    for (i, scale) in scales.iter().enumerate() {
        all[(i, i)] += scale.powi(-2);
    }
    let mut sides = DVector::zeros(ALL);
    sides.rows_mut(0, COMMON).copy_from(right);
    sides.rows_mut(COMMON, 3).copy_from(&after_right.rows(9, 3));
    let common = all.view((0, 0), (COMMON, COMMON)).into_owned().cholesky()?.solve(right);
    let cholesky = all.cholesky()?;
    let solved = cholesky.solve(&sides);
    let gain = solved.dot(&sides) - common.dot(right);
    let inverse = cholesky.inverse();
    let sigma = Vector3::from_fn(|i, _| inverse[(COMMON + i, COMMON + i)].max(0.0).sqrt());
    Some((solved, gain, sigma))
}

/// Where down is, in body axes.
fn down(row: &Row) -> Vector3<f64> {
    let (roll, pitch) = (f64::from(row.attitude.roll_rad), f64::from(row.attitude.pitch_rad));
    Vector3::new(-pitch.sin(), roll.sin() * pitch.cos(), roll.cos() * pitch.cos())
}

#[cfg(test)]
mod tests {
    use autoswing::frames::{Attitude, Field};
    use testkit::random::Random;

    use super::*;

    /// Where the iron changes, of 1800 rows: midway between two instants that are tried.
    const AT: u16 = 1007;

    /// Three minutes of turns with banks of 30 and pitches of 15 deg in a field of 50 uT: `moved` is added from [`AT`] on,
    /// noise to each axis, and what each of 10 A before and 30 A after that adds.
    fn rows(moved: Vector3<f32>, noise_ut: f32, by_current_ut: Vector3<f32>, seed: u64) -> Vec<Row> {
        rows_from(AT, moved, noise_ut, by_current_ut, seed)
    }

    /// The same, with the change at a row.
    fn rows_from(at: u16, moved: Vector3<f32>, noise_ut: f32, by_current_ut: Vector3<f32>, seed: u64) -> Vec<Row> {
        let mut random = Random(seed);
        let of = |i: u16| {
            let (t_s, is_after) = (f32::from(i) / 10.0, i >= at);
            let attitude = Attitude::from_deg(30.0 * (t_s * 0.31).sin(), 15.0 * (t_s * 0.47).sin());
            let earth = attitude.body(Field::earth(50.0, 60_f32.to_radians(), 0.2 * t_s)).ut;
            let noise = Vector3::from_fn(|_, _| random.normal() * noise_ut);
            let current_a = if is_after { 30.0 } else { 10.0 };
            let moved = if is_after { moved } else { Vector3::zeros() };
            let field = Field::new(earth + noise + moved + by_current_ut * current_a);
            Row {
                t_s: f64::from(i) / 10.0,
                field,
                logged: field,
                attitude,
                rates_rad_s: None,
                current_a: Some(current_a),
                usable: true,
                reference_deg: None,
            }
        };
        (0..1800).map(of).collect()
    }

    fn of(moved: [f32; 3], noise_ut: f32, seed: u64) -> Option<Change> {
        found(&rows(moved.into(), noise_ut, Vector3::zeros(), seed), &Iron::none())
    }

    /// To three rows where it is ten times the noise; and its sigma allows for ten neighbours that err alike: where none do,
    /// errors are a third of it.
    #[test]
    fn a_step_is_found_with_its_instant_and_its_sigma() {
        let mut errors = Vec::new();
        for seed in 0..20 {
            let moved = [4.0, -3.0, 2.0];
            let change = of(moved, 0.5, seed).unwrap();
            assert!((change.at_s - f64::from(AT) / 10.0).abs() < 0.35, "{change:?}");
            assert_eq!(change.axis(), 'x');
            errors.extend((0..3).map(|i| (change.ut[i] - f64::from(moved[i])) / change.sigma_ut[i]));
        }
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
        assert!((0.2..0.6).contains(&rms), "{rms}");
    }

    /// Below a microtesla headings hardly change; what is within the noise, or leaves it what it was, is not sure.
    #[test]
    fn what_is_small_or_not_sure_is_no_change() {
        for (moved_ut, noise_ut, is_one) in [(1.3, 0.1, true), (0.8, 0.1, false), (0.0, 0.1, false), (3.0, 5.0, false)]
        {
            for seed in 0..5 {
                let change = of([0.0, moved_ut, 0.0], noise_ut, seed);
                assert_eq!(change.is_some(), is_one, "{moved_ut} uT in {noise_ut}: {change:?}");
            }
        }
    }

    /// The sigma is that of its axis: each axis's errors are a third of its own, however much better another is known.
    #[test]
    fn each_axis_has_its_own_sigma() {
        let moved = [4.0, -3.0, 2.0];
        let changes: Vec<Change> = (0..20).map(|seed| of(moved, 0.5, seed).unwrap()).collect();
        for (axis, expected) in moved.into_iter().map(f64::from).enumerate() {
            let over_sigma = |change: &Change| (change.ut[axis] - expected) / change.sigma_ut[axis];
            let rms = (changes.iter().map(over_sigma).map(|error| error * error).sum::<f64>() / 20.0).sqrt();
            assert!((0.2..0.6).contains(&rms), "{axis}: {rms}");
        }
    }

    /// A step that explains much of the scatter is none where so few rows tell of it that it may be chance: eight sigmas.
    #[test]
    fn few_rows_are_not_sure() {
        for seed in 0..5 {
            let all = rows(Vector3::new(0.0, 3.0, 0.0), 1.0, Vector3::zeros(), seed);
            let few: Vec<Row> = all.iter().step_by(12).copied().collect();
            assert!(found(&all, &Iron::none()).is_some() && found(&few, &Iron::none()).is_none(), "{seed}");
        }
    }

    /// What goes with a current that steps is no iron that moved, if it is known.
    #[test]
    fn what_goes_with_the_current_is_no_change() {
        let by_current_ut = Vector3::new(0.3, -0.2, 0.1);
        let rows = rows(Vector3::zeros(), 0.3, by_current_ut, 1);
        let known = Iron { by_current_ut: by_current_ut.map(f64::from), ..Iron::none() };
        assert_eq!(found(&rows, &known), None);
        let change = found(&rows, &Iron::none()).unwrap();
        assert!((change.ut[0] - 6.0).abs() < 0.5, "20 A of 0.3 uT: {change:?}");
    }

    /// Rows that may not be used, as on the ground, where iron that is not the aircraft's is near, tell of no change in flight.
    #[test]
    fn rows_that_may_not_be_used_tell_of_no_change() {
        let mut rows = rows(Vector3::new(8.0, 0.0, 0.0), 0.3, Vector3::zeros(), 1);
        rows.iter_mut().skip(usize::from(AT)).for_each(|row| row.usable = false);
        assert_eq!(found(&rows, &Iron::none()), None);
    }

    /// Sixty rows on either side, six seconds, tell fourteen unknowns and the three of the step; fewer are not asked.
    #[test]
    fn a_change_has_six_seconds_of_rows_on_either_side() {
        let all = rows(Vector3::new(8.0, -4.0, 3.0), 0.1, Vector3::zeros(), 1);
        let at = usize::from(AT);
        for (around, is_found) in [(59, false), (61, true)] {
            let change = found(&all[at - around..at + around], &Iron::none());
            assert_eq!(change.is_some(), is_found, "{around}: {change:?}");
        }
    }

    /// One row in forty that something else has hit, by twice the Earth's field, is no change, and hides none: it counts as three
    /// times what the others scatter by.
    #[test]
    fn single_rows_that_are_far_off_neither_make_nor_hide_a_change() {
        for seed in 0..4 {
            let hit = |moved_ut: f32| {
                let mut rows = rows(Vector3::new(moved_ut, 0.0, 0.0), 0.3, Vector3::zeros(), seed);
                rows.iter_mut().skip(300).step_by(40).for_each(|row| row.field.ut.y += 100.0);
                found(&rows, &Iron::none())
            };
            assert_eq!(hit(0.0), None, "{seed}");
            let change = hit(4.0).unwrap();
            let off_ut = (Vector3::from(change.ut) - Vector3::new(4.0, 0.0, 0.0)).norm();
            // Thrice its sigma of 0.1 uT.
            assert!(off_ut < 0.3, "{seed}: {change:?}");
        }
    }

    /// With so many rows a step is known to nine of its sigmas of which an eighth of the scatter comes: whatever else that is,
    /// headings would hardly become better without it.
    #[test]
    fn what_leaves_the_scatter_as_it_was_is_no_change() {
        for seed in 0..3 {
            let of = |moved_ut: f32| {
                let both =
                    [seed, seed + 10].map(|seed| rows(Vector3::new(0.0, moved_ut, 0.0), 1.0, Vector3::zeros(), seed));
                let mut rows = both.concat();
                rows.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
                found(&rows, &Iron::none())
            };
            assert_eq!(of(1.7), None, "{seed}");
            assert!(of(3.0).is_some(), "{seed}");
        }
    }

    /// A change soon after the beginning, or shortly before the end, shows in a tenth of the rows, and so hardly in what most
    /// of them scatter by: it is found where those few become nearly twice as good.
    #[test]
    fn a_change_of_few_rows_is_found() {
        for at in [150, 1650] {
            for (moved_ut, noise_ut, is_found) in
                [(8.0, 0.5, true), (5.0, 0.5, true), (0.0, 0.5, false), (2.0, 1.5, false)]
            {
                for seed in 0..4 {
                    let moved = Vector3::new(moved_ut, 0.0, 0.0);
                    let rows = rows_from(at, moved, noise_ut, Vector3::zeros(), seed);
                    // The iron that most rows have: of the rows before it is what moves, seen from those after.
                    let centre_ut = if at < AT { moved.map(f64::from) } else { Vector3::zeros() };
                    let change = found(&rows, &Iron { centre_ut, ..Iron::none() });
                    assert_eq!(change.is_some(), is_found, "{at}, {seed}: {moved_ut} uT in {noise_ut}: {change:?}");
                    if let Some(change) = change {
                        assert!((change.at_s - f64::from(at) / 10.0).abs() < 1.0, "{change:?}");
                        assert!((change.size_ut() - f64::from(moved_ut)).abs() < 1.0, "{change:?}");
                    }
                }
            }
        }
    }
}
