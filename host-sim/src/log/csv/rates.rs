//! From rates that are means between two rows to those at the rows.

use super::super::series::Series;

/// A step that is so many times as long as most is a gap: its mean says little of its ends.
const GAP_STEPS: f64 = 3.0;

/// Rates that are means over the time since the row before, made those at the rows: the mean of the times before and after
/// a row, which neither lags nor leads. A row at the edge of a gap has that of the side where its neighbour is; the mean
/// over a gap is better than nothing where there is no other.
pub(super) fn at_the_rows(rates: &Series<3>) -> Vec<(f64, [f32; 3])> {
    let Some(step_s) = rates.median_step_s() else {
        return rates.rows().iter().map(|row| (row.t_s, row.of)).collect();
    };
    let rows = rates.rows();
    let is_gap = |later: usize| rows[later].t_s - rows[later - 1].t_s > GAP_STEPS * step_s;
    (0..rows.len())
        .map(|i| {
            let before = rows[i].of;
            let after = rows.get(i + 1).filter(|_| !is_gap(i + 1)).map(|next| next.of);
            let begins = i == 0 || is_gap(i);
            let at = match after {
                Some(after) if begins => after,
                Some(after) => std::array::from_fn(|axis| before[axis].midpoint(after[axis])),
                None => before,
            };
            (rows[i].t_s, at)
        })
        .collect()
}
