//! When to ask the pilot for a turn each way: straight flight does not show all of a drift of hard iron, and the sigma
//! of the headings grows with it.

use super::estimate::Estimate;
use crate::time::Timestamp;
use crate::trig::DEG;

/// Heading sigma that requests a turn, radians: above that of ten minutes of straight flight without a drift.
const REQUEST_SIGMA_RAD: f32 = 3.0 * DEG;

/// Heading sigma below which a later growth requests a turn again, radians.
const SETTLED_SIGMA_RAD: f32 = 2.0 * DEG;

/// Time with a sigma above `REQUEST_SIGMA_RAD` before a turn is requested, microseconds: the turns after a sudden
/// change of iron take less.
const REQUEST_DELAY_US: u64 = 20_000_000;

/// Requests a turn once for each growth of the heading sigma.
#[derive(Clone, Copy, Debug)]
pub struct TurnRequest {
    sigma_exceeded_at: Option<Timestamp>,
    is_request_sent: bool,
}

impl TurnRequest {
    /// State in which the sigma has not grown so far.
    pub const NO_GROWTH: Self = Self { sigma_exceeded_at: None, is_request_sent: false };

    /// Updates with an estimate; returns the heading sigma, radians, if a turn is requested.
    pub fn update_request(&mut self, estimate: &Estimate) -> Option<f32> {
        let heading = estimate.smoothed_heading.as_ref().or(estimate.heading.as_ref().ok())?;
        if heading.sigma_rad < SETTLED_SIGMA_RAD {
            *self = Self::NO_GROWTH;
        }
        if heading.sigma_rad < REQUEST_SIGMA_RAD {
            self.sigma_exceeded_at = None;
            return None;
        }
        let sigma_exceeded_at = *self.sigma_exceeded_at.get_or_insert(estimate.timestamp);
        let is_request_due =
            !self.is_request_sent && estimate.timestamp.us_since(sigma_exceeded_at) >= REQUEST_DELAY_US;
        self.is_request_sent |= is_request_due;
        is_request_due.then_some(heading.sigma_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heading::Heading;

    fn request_times_s(sigmas_deg: impl Fn(u32) -> f32) -> Vec<u32> {
        let mut request = TurnRequest::NO_GROWTH;
        let mut asks = |second: &u32| {
            let heading =
                Heading { magnetic_rad: 1.0, sigma_rad: sigmas_deg(*second) * DEG, systematic_variance_rad2: 0.0 };
            let at = Timestamp::from_us(u64::from(*second) * 1_000_000);
            request.update_request(&Estimate { timestamp: at, heading: Ok(heading), ..Estimate::EMPTY }).is_some()
        };
        (0..300).filter(|second| asks(second)).collect()
    }

    /// Over 3 deg for 20 s, and again after it was below 2 deg.
    #[test]
    fn each_growth_of_the_sigma_requests_one_turn() {
        assert_eq!(request_times_s(|_| 3.1), [20]);
        assert_eq!(request_times_s(|_| 2.9), []);
        assert_eq!(request_times_s(|second| if second % 20 == 19 { 2.9 } else { 4.0 }), []);
        assert_eq!(request_times_s(|second| if second == 100 { 2.1 } else { 4.0 }), [20]);
        assert_eq!(request_times_s(|second| if second == 100 { 1.9 } else { 4.0 }), [20, 121]);
        assert_eq!(TurnRequest::NO_GROWTH.clone().update_request(&Estimate::EMPTY), None, "no heading");
    }
}
