//! Whether hard iron has moved since the calibration, said once it is sure.

use nalgebra::Vector3;

/// Hard iron that has moved since the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iron {
    /// What it adds to the corrected field, body axes, microtesla.
    pub change_ut: Vector3<f32>,
    /// Standard deviation of its least certain component, microtesla.
    pub sigma_ut: f32,
}

/// What of it is news, so that a person is told once.
#[derive(Clone, Copy, Debug)]
pub struct IronNews {
    told: Option<Iron>,
}

/// It is told again when it differs from what was told by more than this part of that.
const ANEW: f32 = 0.5;

impl IronNews {
    /// Nothing was told, for all is as calibrated.
    pub const NONE: Self = Self { told: None };

    /// Takes what is sure now; gives it back when it is news, none within for iron that is back where it was.
    pub fn see(&mut self, now: Option<Iron>) -> Option<Option<Iron>> {
        let is_news = match (self.told, now) {
            (None, None) => false,
            (Some(told), Some(now)) => (now.change_ut - told.change_ut).norm() > ANEW * told.change_ut.norm(),
            (Some(_), None) | (None, Some(_)) => true,
        };
        is_news.then(|| {
            self.told = now;
            now
        })
    }
}

/// Iron that moved by less than this part of the total field is not told: 1 uT of 50 turns a heading by 3 deg at most.
const LEAST: f32 = 0.02;

/// It is told when it is so many sigmas of its least certain component.
const SURE_SIGMAS: f32 = 4.0;

/// Without a contradiction for so long, seconds: what passes by is gone by then.
const CALM_S: f32 = 15.0;

/// What was told holds until it is less than this part of what it takes to be told.
const HYSTERESIS: f32 = 0.5;

/// Whether it is told.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    is_told: bool,
    calm_s: f32,
}

impl Moved {
    /// As calibrated.
    pub const NOT: Self = Self { is_told: false, calm_s: 0.0 };

    /// Takes the change that is likely, in units of the total field, with the largest sigma of its components, `step_s`
    /// after the last; says whether it is sure.
    pub fn see(&mut self, change: &Vector3<f32>, sigma: f32, is_silent: bool, step_s: f32) -> bool {
        self.calm_s = if is_silent { 0.0 } else { self.calm_s + step_s };
        let part = change.norm() / LEAST.max(SURE_SIGMAS * sigma);
        if self.is_told {
            // Less certain is not less moved.
            self.is_told = change.norm() > HYSTERESIS * LEAST;
        } else {
            self.is_told = self.calm_s >= CALM_S && part > 1.0;
        }
        self.is_told
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For so long, in tenths of a second; whether it is told at the end.
    fn told(moved: &mut Moved, change: f32, sigma: f32, is_silent: bool, tenths: usize) -> bool {
        (0..tenths).map(|_| moved.see(&Vector3::new(0.0, -change, 0.0), sigma, is_silent, 0.1)).last().unwrap()
    }

    #[test]
    fn what_is_large_and_sure_is_told() {
        for (change, sigma, expected) in
            [(0.021, 0.005, true), (0.019, 0.001, false), (0.1, 0.024, true), (0.1, 0.026, false)]
        {
            assert_eq!(told(&mut Moved::NOT.clone(), change, sigma, false, 200), expected, "{change} {sigma}");
        }
    }

    #[test]
    fn news_are_told_once() {
        let iron = |y_ut: f32| Some(Iron { change_ut: Vector3::new(0.0, y_ut, 0.0), sigma_ut: 0.1 });
        let mut news = IronNews::NONE;
        for (now, expected) in [
            (None, None),
            (iron(4.0), Some(iron(4.0))),
            (iron(4.1), None),
            (iron(5.9), None),
            (iron(2.1), None),
            (iron(6.1), Some(iron(6.1))),
            (iron(3.2), None),
            (iron(-6.0), Some(iron(-6.0))),
            (None, Some(None)),
            (None, None),
        ] {
            assert_eq!(news.see(now), expected, "{now:?}");
        }
    }

    #[test]
    fn fifteen_seconds_of_calm_come_first() {
        let mut moved = Moved::NOT;
        assert!(!told(&mut moved, 0.1, 0.01, true, 300));
        assert!(!told(&mut moved, 0.1, 0.01, false, 149));
        assert!(told(&mut moved, 0.1, 0.01, false, 2));
    }

    /// It moved back; a moment of uncertainty in between is none of its business.
    #[test]
    fn what_was_told_holds_until_it_is_gone() {
        let mut moved = Moved::NOT;
        assert!(told(&mut moved, 0.1, 0.01, false, 200));
        assert!(told(&mut moved, 0.1, 0.2, true, 50));
        assert!(told(&mut moved, 0.011, 0.01, false, 1));
        assert!(!told(&mut moved, 0.009, 0.01, false, 1));
        assert!(!told(&mut moved, 0.011, 0.001, false, 200));
    }
}
