//! Numbers in time: in the order of time, each instant once, and never more than fit into memory.

use autoswing::frames::wrap_pi;

/// No series is longer: 16 MB of six numbers each, and five times as much of what is made of the rows of a compass. What is
/// longer is thinned to every second row, again and again, as long as ten a second are left; then to every second [`PART_S`].
const MAX_ROWS: usize = 1 << 19;

/// Parts of a flight that are kept whole, seconds: of every series the same ones, turns and all.
const PART_S: f64 = 256.0;

/// Rows in a second, below which half of them were too few.
const FEW_HZ: f64 = 20.0;

/// So many numbers of an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamped<const N: usize> {
    /// Seconds on the flight's time line.
    pub t_s: f64,
    /// The numbers.
    pub of: [f32; N],
}

/// So many numbers in time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series<const N: usize> {
    rows: Vec<Stamped<N>>,
    /// Every so manyeth is kept, by powers of two.
    thinned: u8,
    /// Every so manyeth part is kept, by powers of two.
    parts: u8,
    seen: u64,
}

impl<const N: usize> Series<N> {
    /// Nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { rows: Vec::new(), thinned: 0, parts: 0, seen: 0 }
    }

    /// Adds what was logged, in the order of the file.
    pub fn push(&mut self, t_s: f64, of: [f32; N]) {
        if !is_kept(t_s, self.parts) {
            return;
        }
        self.seen += 1;
        if !self.seen.is_multiple_of(1 << self.thinned) {
            return;
        }
        if self.rows.len() >= MAX_ROWS {
            self.thin();
            if !self.seen.is_multiple_of(1 << self.thinned) || !is_kept(t_s, self.parts) {
                return;
            }
        }
        self.rows.push(Stamped { t_s, of });
    }

    /// To half of it, or, of a part that is longer than all, again.
    fn thin(&mut self) {
        let mut steps_s: Vec<f64> = self.rows.windows(2).map(|pair| (pair[1].t_s - pair[0].t_s).abs()).collect();
        let middle = steps_s.len() / 2;
        let step_s = *steps_s.select_nth_unstable_by(middle, f64::total_cmp).1;
        if step_s * FEW_HZ >= 1.0 && self.parts < 40 {
            self.parts += 1;
            let parts = self.parts;
            self.rows.retain(|row| is_kept(row.t_s, parts));
        }
        if self.rows.len() >= MAX_ROWS / 4 * 3 {
            let mut kept = 0_u32;
            self.rows.retain(|_| {
                kept += 1;
                kept.is_multiple_of(2)
            });
            self.thinned += 1;
        }
    }

    /// Sorts by time and drops what repeats an instant; how many that were.
    pub fn settle(&mut self) -> usize {
        let before = self.rows.len();
        self.rows.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        self.rows.dedup_by(|later, first| later.t_s <= first.t_s);
        before - self.rows.len()
    }

    /// The rows.
    #[must_use]
    pub fn rows(&self) -> &[Stamped<N>] {
        &self.rows
    }

    /// The rows, to be changed; their times stay in order.
    pub fn rows_mut(&mut self) -> &mut [Stamped<N>] {
        &mut self.rows
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The last row at or before an instant and the first after it.
    #[must_use]
    pub fn around(&self, t_s: f64) -> (Option<&Stamped<N>>, Option<&Stamped<N>>) {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        (after.checked_sub(1).and_then(|before| self.rows.get(before)), self.rows.get(after))
    }

    /// The rows around an instant and where it lies between them, 0 to 1; none before the first, after the last, and
    /// where they are further apart than `max_gap_s`.
    #[must_use]
    pub fn between(&self, t_s: f64, max_gap_s: f64) -> Option<(&Stamped<N>, &Stamped<N>, f64)> {
        let (before, after) = self.around(t_s);
        let before = before?;
        let Some(after) = after else { return (before.t_s >= t_s).then_some((before, before, 0.0)) };
        let gap_s = after.t_s - before.t_s;
        (gap_s <= max_gap_s).then(|| (before, after, (t_s - before.t_s) / gap_s))
    }

    /// Each number at an instant, on the straight line between its neighbours.
    #[must_use]
    pub fn at(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let (before, after, part) = self.between(t_s, max_gap_s)?;
        Some(std::array::from_fn(|i| before.of[i] + part as f32 * (after.of[i] - before.of[i])))
    }

    /// The same, and beyond the last row what that says, for as long.
    #[must_use]
    pub fn held_at(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let last = self.rows.last().filter(|last| (0.0..=max_gap_s).contains(&(t_s - last.t_s)));
        last.map(|last| last.of).or_else(|| self.at(t_s, max_gap_s))
    }

    /// As [`at`](Self::at) of angles in radians, the shorter way round.
    #[must_use]
    pub fn angles_at(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let (before, after, part) = self.between(t_s, max_gap_s)?;
        Some(std::array::from_fn(|i| wrap_pi(before.of[i] + part as f32 * wrap_pi(after.of[i] - before.of[i]))))
    }

    /// The time from one row to the next, as most are, seconds.
    #[must_use]
    pub fn median_step_s(&self) -> Option<f64> {
        let mut steps_s: Vec<f64> = self.rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
        let middle = steps_s.len() / 2;
        (!steps_s.is_empty()).then(|| *steps_s.select_nth_unstable_by(middle, f64::total_cmp).1)
    }
}

/// Whether an instant is in a part that is kept.
fn is_kept(t_s: f64, parts: u8) -> bool {
    ((t_s / PART_S).floor() as i64).rem_euclid(1 << parts) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[(f64, f32)]) -> Series<1> {
        let mut series = Series::new();
        for &(t_s, value) in rows {
            series.push(t_s, [value]);
        }
        series
    }

    #[test]
    fn rows_are_sorted_and_an_instant_is_there_once_with_what_was_logged_first() {
        let mut series = of(&[(1.0, 1.0), (3.0, 3.0), (2.0, 2.0), (3.0, 9.0)]);
        assert_eq!(series.settle(), 1);
        assert_eq!(series.rows().iter().map(|row| row.of[0]).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn between_rows_numbers_lie_on_a_line_and_a_gap_has_none() {
        let series = of(&[(1.0, 10.0), (2.0, 20.0), (4.0, 40.0)]);
        assert_eq!(series.at(1.25, 1.0), Some([12.5]));
        assert_eq!(series.at(1.0, 1.0), Some([10.0]));
        assert_eq!(series.at(4.0, 1.0), Some([40.0]));
        assert_eq!(series.at(3.0, 2.0), Some([30.0]));
        assert_eq!(series.held_at(5.0, 1.0), Some([40.0]));
        assert_eq!((series.held_at(5.001, 1.0), series.held_at(1.25, 1.0)), (None, Some([12.5])));
        for outside in [0.999, 4.001, 3.0] {
            assert_eq!(series.at(outside, 1.999), None, "{outside}");
        }
    }

    #[test]
    fn angles_go_the_shorter_way() {
        let series = of(&[(0.0, 3.0), (1.0, -3.0)]);
        let [angle] = series.angles_at(0.5, 1.0).unwrap();
        assert!((angle.abs() - std::f32::consts::PI).abs() < 1e-5, "{angle}");
    }

    #[test]
    fn memory_is_bounded_and_what_is_kept_is_spread_evenly() {
        let mut series = Series::new();
        let number = 3 * MAX_ROWS;
        for i in 0..number {
            series.push(i as f64 * 0.01, [0.0]);
        }
        assert!(series.rows().len() <= MAX_ROWS && series.rows().len() > MAX_ROWS / 2, "{}", series.rows().len());
        let steps: Vec<f64> = series.rows().windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
        assert!(steps.iter().all(|step| (step - 0.04).abs() < 1e-6), "{:?}", &steps[..4]);
    }

    /// Of days at 10 Hz every second part is kept, with all of its rows: an attitude of 1 Hz would be none.
    #[test]
    fn what_comes_ten_times_a_second_is_thinned_by_parts() {
        let mut series = Series::new();
        for i in 0..3 * MAX_ROWS {
            series.push(i as f64 * 0.1, [0.0]);
        }
        assert!(series.rows().len() <= MAX_ROWS && series.rows().len() > MAX_ROWS / 2, "{}", series.rows().len());
        assert!((series.median_step_s().unwrap() - 0.1).abs() < 1e-6);
        let gaps = series.rows().windows(2).filter(|pair| pair[1].t_s - pair[0].t_s > 1.0).count();
        assert_eq!(gaps, (3.0 * MAX_ROWS as f64 * 0.1 / PART_S / 4.0) as usize);
    }
}
