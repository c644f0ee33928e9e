//! Body rates of a recording: from means over the time between two rows to what they were at the rows.

use super::recording::Row;

/// A step that is so many times as long as most is a gap: its mean says little of its ends.
const GAP_STEPS: f64 = 3.0;

/// Makes the rates that were read, means over the time since the row before, those at the rows: the mean of the times
/// before and after a row, which neither lags nor leads. A row at the edge of a gap, or of rows without rates, has that
/// of the side where its neighbour is; the mean over a gap is better than nothing where there is no other.
pub(super) fn at_the_rows(rows: &mut [Row]) {
    let Some(step_s) = median_step_s(rows) else { return };
    for i in 0..rows.len() {
        let Some(before) = rows[i].rates_rad_s else { continue };
        let is_gap = |later: usize| rows[later].t_s - rows[later - 1].t_s > GAP_STEPS * step_s;
        let after = rows.get(i + 1).filter(|_| !is_gap(i + 1)).and_then(|next| next.rates_rad_s);
        let begins = i == 0 || is_gap(i);
        rows[i].rates_rad_s = Some(match after {
            Some(after) if begins => after,
            Some(after) => std::array::from_fn(|axis| before[axis].midpoint(after[axis])),
            None => before,
        });
    }
}

/// The time from one row to the next, as most are, seconds; none of a single row.
pub(super) fn median_step_s(rows: &[Row]) -> Option<f64> {
    let mut steps_s: Vec<f64> = rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    steps_s.sort_by(f64::total_cmp);
    steps_s.get(steps_s.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use autoswing::frames::{Attitude, Field};

    use super::*;

    /// What the rates of these times, about one axis, become.
    fn found(read: &[(f64, Option<f32>)]) -> Vec<Option<f32>> {
        let mut rows: Vec<Row> = read
            .iter()
            .map(|&(t_s, rate)| Row {
                t_s,
                field: Field::from_ut(1.0, 2.0, 3.0),
                attitude: Attitude::default(),
                rates_rad_s: rate.map(|rate| [0.0, rate, -rate]),
                usable: true,
                reference_deg: None,
            })
            .collect();
        at_the_rows(&mut rows);
        rows.iter()
            .map(|row| {
                row.rates_rad_s.map(|[p, q, r]| {
                    assert_eq!((p, r), (0.0, -q));
                    q
                })
            })
            .collect()
    }

    /// Of a rate that grows evenly from nothing, the mean of each second is half a second old.
    #[test]
    fn a_row_s_rate_is_that_of_its_instant() {
        let read: Vec<_> = (0..5).map(|i| (f64::from(i), Some(i as f32 - 0.5))).collect();
        assert_eq!(found(&read), [0.5, 1.0, 2.0, 3.0, 3.5].map(Some));
    }

    /// Steps of one second, one of three and one of a little more.
    #[test]
    fn nothing_is_taken_from_beyond_a_gap() {
        let read = [(0.0, 9.0), (1.0, 2.0), (2.0, 4.0), (5.0, 8.0), (6.0, 2.0), (9.1, 7.0), (10.1, 4.0), (11.1, 6.0)];
        let expected = [2.0, 3.0, 6.0, 5.0, 2.0, 4.0, 5.0, 6.0];
        assert_eq!(found(&read.map(|(t_s, rate)| (t_s, Some(rate)))), expected.map(Some));
        assert_eq!(found(&[(0.0, Some(1.0))]), [Some(1.0)]);
        assert_eq!(found(&[(0.0, Some(1.0)), (1.0, Some(3.0)), (9.0, Some(5.0))])[2], Some(5.0));
    }

    #[test]
    fn a_row_without_rates_has_none_and_gives_none() {
        let read = [(0.0, Some(1.0)), (1.0, Some(2.0)), (2.0, None), (3.0, Some(4.0)), (4.0, Some(6.0))];
        assert_eq!(found(&read), [Some(2.0), Some(2.0), None, Some(5.0), Some(6.0)]);
    }
}
