//! Heading by the body rates, from an arbitrary north: no compass has a part in it.

use super::flight::LoggedFlight;

/// Longest gap of attitude that is interpolated, seconds.
const MAX_ATTITUDE_GAP_S: f64 = 0.7;

/// Pitch beyond which roll and heading are singular, as of a tailsitter in hover, radians (75 deg): errors of heading are
/// four times those of the attitude, and more.
pub(crate) const MAX_PITCH_RAD: f32 = 1.3;

/// Integral of the heading's rate by the body rates, in the attitude that is logged.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeadingIntegral {
    rows: Vec<IntegralRow>,
}

#[derive(Clone, Debug)]
struct IntegralRow {
    t_s: f64,
    heading_rad: f64,
    /// Number of the part of the flight without a gap.
    part: usize,
}

impl HeadingIntegral {
    /// Integrates the body rates of a flight in parts between gaps of more than `max_gap_s`.
    pub(crate) fn new(flight: &LoggedFlight, max_gap_s: f64) -> Self {
        let mut rows: Vec<IntegralRow> = Vec::with_capacity(flight.body_rates.rows().len());
        let mut last_rate_rad_s = 0.0;
        for row in flight.body_rates.rows() {
            let attitude = flight.attitude.interpolate_angles(row.t_s, MAX_ATTITUDE_GAP_S);
            let Some([roll_rad, pitch_rad, _]) = attitude else { continue };
            if pitch_rad.abs() > MAX_PITCH_RAD {
                continue;
            }
            let [_, q, r] = row.row_values;
            let (sin_roll, cos_roll) = libm::sincosf(roll_rad);
            let rate_rad_s = f64::from((q * sin_roll + r * cos_roll) / libm::cosf(pitch_rad));
            let (heading_rad, part) = rows.last().map_or((0.0, 0), |last| {
                let step_s = row.t_s - last.t_s;
                let heading_rad = last.heading_rad + step_s * rate_rad_s.midpoint(last_rate_rad_s);
                (heading_rad, last.part + usize::from(step_s > max_gap_s))
            });
            rows.push(IntegralRow { t_s: row.t_s, heading_rad, part });
            last_rate_rad_s = rate_rad_s;
        }
        Self { rows }
    }

    /// The integral of a test: times, seconds, and headings, radians.
    #[cfg(test)]
    pub(crate) fn from_points(points: impl Iterator<Item = (f64, f64)>, max_gap_s: f64) -> Self {
        let mut rows: Vec<IntegralRow> = Vec::new();
        for (t_s, heading_rad) in points {
            let part = rows.last().map_or(0, |last| last.part + usize::from(t_s - last.t_s > max_gap_s));
            rows.push(IntegralRow { t_s, heading_rad, part });
        }
        Self { rows }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Part of the flight without a gap, and the heading in it, radians; none outside the rates and in gaps.
    pub(crate) fn part_and_heading_rad(&self, t_s: f64) -> Option<(usize, f64)> {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        let (from, to) = (self.rows.get(after.checked_sub(1)?)?, self.rows.get(after)?);
        let weight = (t_s - from.t_s) / (to.t_s - from.t_s);
        let heading_rad = from.heading_rad + weight * (to.heading_rad - from.heading_rad);
        (from.part == to.part).then_some((from.part, heading_rad))
    }

    /// Heading, radians; none outside the rates and in gaps.
    pub(crate) fn heading_rad(&self, t_s: f64) -> Option<f64> {
        self.part_and_heading_rad(t_s).map(|(_, heading_rad)| heading_rad)
    }
}
