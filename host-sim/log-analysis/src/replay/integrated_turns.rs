//! Turn of the aircraft by its body rates, in which no compass has a part.

use crate::log::LoggedFlight;
use crate::replay::data_loss::SLOW_ATTITUDE_INTERVAL_S;

/// Longest gap of rates or attitude that is integrated across, seconds.
const MAX_GAP_S: f64 = 0.5;
/// Pitch beyond which a heading is undefined, radians (75 deg).
pub(super) const MAX_PITCH_RAD: f32 = 1.3;

/// Integral of the heading's rate by the body rates, in the attitude that is logged.
pub(super) struct IntegratedTurns {
    rows: Vec<TurnRow>,
}

struct TurnRow {
    t_s: f64,
    /// Turn since the first row, degrees; across a gap it is wrong.
    turn_deg: f64,
    /// Number of the part of the flight without a gap.
    part: usize,
}

impl IntegratedTurns {
    /// Integrates the body rates of a flight; empty if they were not measured, or are logged too slowly.
    pub(super) fn new(flight: &LoggedFlight) -> Self {
        let is_slow = flight.attitude.median_step_s().is_some_and(|step_s| step_s > SLOW_ATTITUDE_INTERVAL_S);
        if !flight.has_measured_rates || is_slow {
            return Self { rows: Vec::new() };
        }
        let mut rows: Vec<TurnRow> = Vec::with_capacity(flight.body_rates.rows().len());
        let mut last_rate_deg_s = 0.0;
        for row in flight.body_rates.rows() {
            let Some([roll_rad, pitch_rad, _]) = flight.attitude.interpolate_angles(row.t_s, MAX_GAP_S) else {
                continue;
            };
            if pitch_rad.abs() > MAX_PITCH_RAD {
                continue;
            }
            let [_, q, r] = row.row_values;
            let (sin_roll, cos_roll) = libm::sincosf(roll_rad);
            let rate_deg_s = f64::from(((q * sin_roll + r * cos_roll) / libm::cosf(pitch_rad)).to_degrees());
            let (turn_deg, part) = rows.last().map_or((0.0, 0), |last| {
                let step_s = row.t_s - last.t_s;
                let turn_deg = last.turn_deg + step_s * f64::midpoint(last_rate_deg_s, rate_deg_s);
                (turn_deg, last.part + usize::from(step_s > MAX_GAP_S))
            });
            rows.push(TurnRow { t_s: row.t_s, turn_deg, part });
            last_rate_deg_s = rate_deg_s;
        }
        Self { rows }
    }

    /// Part of the flight without a gap, and the turn in it, degrees; none outside the rates and in gaps.
    pub(super) fn part_and_turn_deg(&self, t_s: f64) -> Option<(usize, f64)> {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        let (from, to) = (self.rows.get(after.checked_sub(1)?)?, self.rows.get(after)?);
        let weight = (t_s - from.t_s) / (to.t_s - from.t_s);
        (from.part == to.part).then_some((from.part, from.turn_deg + weight * (to.turn_deg - from.turn_deg)))
    }
}
