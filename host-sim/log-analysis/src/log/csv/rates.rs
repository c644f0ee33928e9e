//! Rates at the rows of a table.

use super::super::time_series::Series;

/// Interval between rows, in median steps, that counts as a gap: a mean rate over it does not represent its ends.
const MAX_GAP_IN_MEDIAN_STEPS: f64 = 3.0;

/// Converts means over the preceding interval to rates at the rows: the average of the means before and after, which
/// has no lag. At a gap only the mean of the side without the gap is used, if there is one.
pub(super) fn rates_at_rows(mean_rates: &Series<3>) -> Vec<(f64, [f32; 3])> {
    let Some(step_s) = mean_rates.median_step_s() else {
        return mean_rates.rows().iter().map(|row| (row.t_s, row.row_values)).collect();
    };
    let rows = mean_rates.rows();
    let is_gap = |later: usize| rows[later].t_s - rows[later - 1].t_s > MAX_GAP_IN_MEDIAN_STEPS * step_s;
    (0..rows.len())
        .map(|i| {
            let before = rows[i].row_values;
            let after = rows.get(i + 1).filter(|_| !is_gap(i + 1)).map(|next| next.row_values);
            let is_after_gap = i == 0 || is_gap(i);
            let rate = match after {
                Some(after) if is_after_gap => after,
                Some(after) => std::array::from_fn(|axis| before[axis].midpoint(after[axis])),
                None => before,
            };
            (rows[i].t_s, rate)
        })
        .collect()
}
