//! True heading in straight flight from GPS velocities, independent of any compass.
//!
//! Ground velocity is air velocity plus wind. At constant airspeed the velocities of a flight lie on a circle about the
//! wind, fitted to velocities alone: a wind estimated from headings could not be distinguished from hard iron, whose
//! error also has one cycle a turn. A fixed-wing aircraft points along its air velocity except for sideslip. The
//! receiver's unknown latency does not matter in straight flight.

use autoswing::frames::wrap_pi;
use nalgebra::{Vector2, Vector3};

use crate::least_squares::LeastSquares;
use crate::log::time_series::Series;
use crate::log::{Gps, HeadingIntegral, LoggedFlight};
use crate::numbers::{SIGMAS_PER_MEDIAN, median, rms, square, thinned};

/// Largest bank in straight flight, degrees; gusts roll by a few.
const MAX_BANK_DEG: f32 = 10.0;
/// Straight flight required before and after a velocity, seconds: receivers are 0.1 to 0.4 s late, a roll-out takes 1
/// s.
const MIN_STRAIGHT_S: f64 = 2.0;

/// Largest mean turn rate in straight flight, degrees a second; single gyro readings vibrate.
const MAX_TURN_RATE_DEG_S: f64 = 3.0;

/// Largest number of velocities to which a circle is fitted.
const MAX_FITTED_VELOCITIES: usize = 5000;

/// Largest interpolation gap, seconds; MAVLink logs have 1 Hz.
const MAX_GAP_S: f64 = 1.5;

/// Least ground speed in flight, m/s.
const MIN_SPEED_M_S: f64 = 4.0;
/// Least ground speed in flight as a fraction of the 90th percentile: excludes taxiing and hover. In a wind of half the
/// airspeed a third remains upwind.
const MIN_FRACTION_OF_FAST_SPEED: f64 = 0.3;

/// Least airspeed, m/s; slower vehicles drift.
const MIN_AIRSPEED_M_S: f64 = 8.0;
/// Least ratio of airspeed to wind speed.
const MIN_AIRSPEED_TO_WIND_RATIO: f64 = 2.0;

/// Largest radial residual of a velocity near the circle, as a fraction of airspeed.
const MAX_RADIAL_RESIDUAL: f64 = 0.15;
/// Least fraction of velocities near the circle.
const MIN_FRACTION_ON_CIRCLE: f64 = 0.7;

/// Largest standard deviation of the wind as a fraction of airspeed: 2.9 deg of heading.
const MAX_WIND_SIGMA: f64 = 0.05;

/// Least time of straight flight in a direction, seconds.
const MIN_TIME_PER_DIRECTION_S: f64 = 3.0;
/// Largest angle between neighbouring directions, degrees: out and back observes only one component of a one-cycle
/// error.
const MAX_DIRECTION_GAP_DEG: f64 = 150.0;

/// Assumed sideslip, degrees, which no log shows: gusts of 0.5 m/s at 20 m/s.
const ASSUMED_SIDESLIP_DEG: f64 = 1.5;

/// Parts of the flight for the jackknife variance of the wind; each contains gusts and drift.
const JACKKNIFE_PARTS: usize = 10;

/// Headings in straight flight with the wind solution.
#[derive(Clone, Debug, PartialEq)]
pub struct GpsCourseHeading {
    /// Wind velocity towards true north and east, m/s.
    pub wind_m_s: [f64; 2],
    /// Standard deviation of a wind component within a tenth of the flight, m/s.
    pub wind_sigma_m_s: f64,
    /// Horizontal airspeed, m/s.
    pub airspeed_m_s: f64,
    /// RMS distance of straight flight from the circle, m/s.
    pub scatter_m_s: f64,
    /// Largest angle between neighbouring straight directions, degrees.
    pub widest_gap_deg: f64,
    heading: Series<1>,
}

/// Reason why GPS course gives no heading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpsCourseRejection {
    /// No velocity over ground is logged.
    NotLogged,
    /// The aircraft is a rotorcraft.
    Copter,
    /// No body rates to compare turns of the nose with the course.
    NoRates,
    /// The aircraft never flew fast enough.
    TooSlow,
    /// The velocities lie on no circle.
    NoCircle,
    /// The wind is too strong for the airspeed.
    StrongWind,
    /// Too few directions were flown straight.
    FewDirections,
    /// The wind estimate is too uncertain.
    UncertainWind,
    /// The nose turned differently from the course.
    NoseMismatch,
}

impl GpsCourseRejection {
    /// Description of the reason.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::NotLogged => "no velocity over ground is logged",
            Self::Copter => "a copter's nose need not point where it flies",
            Self::NoRates => "no body rates are logged to compare the turn of the nose with that of the course",
            Self::TooSlow => "it never flew fast enough",
            Self::NoCircle => "velocities over ground lie on no circle about a wind: airspeed or wind changed",
            Self::StrongWind => "the wind was more than half of the airspeed",
            Self::FewDirections => "it did not fly straight in three directions or more all round",
            Self::UncertainWind => "the wind is not certain enough: it changed, or too few directions were flown",
            Self::NoseMismatch => "the nose did not turn as the course did",
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct GroundVelocity {
    t_s: f64,
    /// Velocity towards true north and east, m/s.
    velocity_m_s: Vector2<f64>,
}

impl GpsCourseHeading {
    /// Estimates headings from a flight's velocities.
    ///
    /// # Errors
    ///
    /// The reason why they give no heading.
    pub fn from_flight(flight: &LoggedFlight) -> Result<Self, GpsCourseRejection> {
        let velocities = ground_velocities(flight);
        if velocities.is_empty() {
            return Err(GpsCourseRejection::NotLogged);
        }
        if flight.is_copter {
            return Err(GpsCourseRejection::Copter);
        }
        let flight_velocities = velocities_in_flight(velocities).ok_or(GpsCourseRejection::TooSlow)?;
        let fitted = thinned(&flight_velocities, MAX_FITTED_VELOCITIES);
        let circle = VelocityCircle::fit_robustly(&fitted).ok_or(GpsCourseRejection::NoCircle)?;
        let on_circle_velocities = velocities_near_circle(&flight_velocities, &circle)?;
        let heading_integral = NoseHeadings::from_flight(flight).ok_or(GpsCourseRejection::NoRates)?;
        let straight: Vec<GroundVelocity> = on_circle_velocities
            .iter()
            .filter(|velocity| heading_integral.is_straight(velocity.t_s))
            .copied()
            .collect();
        let course = Self::from_fitted_circle(&circle, &fitted, &straight)?;
        if !heading_integral.nose_turns_with_velocity(&on_circle_velocities, &circle) {
            return Err(GpsCourseRejection::NoseMismatch);
        }
        Ok(course)
    }

    /// Checks the circle and computes the headings of straight flight.
    fn from_fitted_circle(
        circle: &VelocityCircle,
        fitted: &[GroundVelocity],
        straight: &[GroundVelocity],
    ) -> Result<Self, GpsCourseRejection> {
        let airspeed_m_s = circle.radius_m_s;
        let widest_gap_deg = widest_gap_deg(straight, circle);
        if widest_gap_deg > MAX_DIRECTION_GAP_DEG {
            return Err(GpsCourseRejection::FewDirections);
        }
        let scatter_m_s = rms(straight.iter().map(|velocity| circle.radial_residual_m_s(velocity)));
        if airspeed_m_s < MIN_AIRSPEED_TO_WIND_RATIO * circle.wind_m_s.norm() {
            return Err(GpsCourseRejection::StrongWind);
        }
        let wind_sigma_m_s = VelocityCircle::wind_sigma_m_s(fitted).ok_or(GpsCourseRejection::UncertainWind)?;
        if wind_sigma_m_s > MAX_WIND_SIGMA * airspeed_m_s {
            return Err(GpsCourseRejection::UncertainWind);
        }
        let heading = straight.iter().map(|velocity| (velocity.t_s, [circle.heading_rad(velocity) as f32])).collect();
        let wind_m_s = circle.wind_m_s.into();
        Ok(Self { wind_m_s, wind_sigma_m_s, airspeed_m_s, scatter_m_s, widest_gap_deg, heading })
    }

    /// True heading at a time in straight flight, radians.
    #[must_use]
    pub fn heading_rad(&self, t_s: f64) -> Option<f32> {
        self.heading.interpolate_angles(t_s, MAX_GAP_S).map(|[heading_rad]| heading_rad)
    }

    /// Wind speed, m/s.
    #[must_use]
    pub fn wind_speed_m_s(&self) -> f64 {
        libm::hypot(self.wind_m_s[0], self.wind_m_s[1])
    }

    /// Direction the wind comes from, degrees from true north.
    #[must_use]
    pub fn wind_from_deg(&self) -> f64 {
        libm::atan2(-self.wind_m_s[1], -self.wind_m_s[0]).to_degrees().rem_euclid(360.0)
    }

    /// Description of the reference's accuracy.
    #[must_use]
    pub fn accuracy_description(&self) -> String {
        format!(
            "no compass is in it: ground velocity less a wind of {:.1} m/s from {:.0} deg true, which the velocities \
             themselves show; {:.1} m/s through the air, scatter {:.1}. Its own sigma, which is in the figures, is up to \
             {:.1} deg: {:.1} of the wind as it changed in the flight, {ASSUMED_SIDESLIP_DEG} assumed for sideslip. It says \
             nothing of banked flight, nor of directions that were not flown straight: the widest gap is {:.0} deg",
            self.wind_speed_m_s(),
            self.wind_from_deg(),
            self.airspeed_m_s,
            self.scatter_m_s,
            self.sigma_deg(),
            self.wind_sigma_deg(),
            self.widest_gap_deg,
        )
    }

    /// Standard deviation of a heading, degrees, from wind and assumed sideslip; airspeed changes act along the
    /// heading.
    #[must_use]
    pub fn sigma_deg(&self) -> f64 {
        libm::hypot(self.wind_sigma_deg(), ASSUMED_SIDESLIP_DEG)
    }

    fn wind_sigma_deg(&self) -> f64 {
        (self.wind_sigma_m_s / self.airspeed_m_s).to_degrees()
    }
}

fn ground_velocities(flight: &LoggedFlight) -> Vec<GroundVelocity> {
    let ground_velocity = |row: &crate::log::time_series::TimedRow<6>| {
        let Gps { speed_m_s, course_deg, .. } = Gps::from_columns(row.row_values);
        let (sin, cos) = libm::sincos(f64::from(course_deg).to_radians());
        let m_s = Vector2::new(cos, sin) * f64::from(speed_m_s);
        m_s.norm().is_finite().then_some(GroundVelocity { t_s: row.t_s, velocity_m_s: m_s })
    };
    flight.gps.rows().iter().filter_map(ground_velocity).collect()
}

/// Velocities in flight, if enough.
fn velocities_in_flight(velocities: Vec<GroundVelocity>) -> Option<Vec<GroundVelocity>> {
    const MIN_VELOCITIES: usize = 30;
    let mut speeds: Vec<f64> =
        velocities.iter().map(|velocity| velocity.velocity_m_s.norm()).filter(|m_s| *m_s > MIN_SPEED_M_S).collect();
    speeds.sort_by(f64::total_cmp);
    let fast_m_s = *speeds.get(speeds.len() * 9 / 10)?;
    let least_m_s = MIN_SPEED_M_S.max(MIN_FRACTION_OF_FAST_SPEED * fast_m_s);
    let flight_velocities: Vec<GroundVelocity> =
        velocities.into_iter().filter(|velocity| velocity.velocity_m_s.norm() > least_m_s).collect();
    (flight_velocities.len() >= MIN_VELOCITIES).then_some(flight_velocities)
}

/// Velocities near the circle, if most are.
fn velocities_near_circle(
    flight_velocities: &[GroundVelocity],
    circle: &VelocityCircle,
) -> Result<Vec<GroundVelocity>, GpsCourseRejection> {
    let airspeed_m_s = circle.radius_m_s;
    if airspeed_m_s < MIN_AIRSPEED_M_S {
        return Err(GpsCourseRejection::TooSlow);
    }
    let near_circle: Vec<GroundVelocity> = flight_velocities
        .iter()
        .filter(|velocity| circle.radial_residual_m_s(velocity).abs() < MAX_RADIAL_RESIDUAL * airspeed_m_s)
        .copied()
        .collect();
    let is_most = near_circle.len() as f64 >= MIN_FRACTION_ON_CIRCLE * flight_velocities.len() as f64;
    is_most.then_some(near_circle).ok_or(GpsCourseRejection::NoCircle)
}

/// Largest angle between neighbouring directions flown straight, degrees; 360 if none was flown.
fn widest_gap_deg(straight: &[GroundVelocity], circle: &VelocityCircle) -> f64 {
    const DIRECTION_BINS: usize = 72;
    const BIN_DEG: f64 = 360.0 / DIRECTION_BINS as f64;
    let mut flown_s = [0.0; DIRECTION_BINS];
    for pair in straight.windows(2) {
        let bin = (circle.heading_rad(&pair[0]).to_degrees().rem_euclid(360.0) / BIN_DEG) as usize % DIRECTION_BINS;
        let step_s = pair[1].t_s - pair[0].t_s;
        flown_s[bin] += if step_s < MAX_GAP_S { step_s } else { 0.0 };
    }
    // The flight time of a heading bin includes both adjacent bins, since gusts spread one straight leg over several.
    let is_flown = |bin: usize| {
        let around = [DIRECTION_BINS - 1, 0, 1].map(|bin_offset| flown_s[(bin + bin_offset) % DIRECTION_BINS]);
        flown_s[bin % DIRECTION_BINS] > 0.0 && around.iter().sum::<f64>() >= MIN_TIME_PER_DIRECTION_S
    };
    let (mut empty, mut widest) = (0, 0);
    for bin in 0..2 * DIRECTION_BINS {
        empty = if is_flown(bin) { 0 } else { empty + 1 };
        widest = widest.max(empty + 1);
    }
    (f64::from(widest) * BIN_DEG).min(360.0)
}

/// Circle of ground velocities at one airspeed in one wind.
#[derive(Clone, Copy, Debug)]
struct VelocityCircle {
    wind_m_s: Vector2<f64>,
    radius_m_s: f64,
}

impl VelocityCircle {
    /// Robust fit: algebraic start, then iteratively reweighted least squares.
    fn fit_robustly(velocities: &[GroundVelocity]) -> Option<Self> {
        let mut circle = Self::initial_fit(velocities)?;
        for _ in 0..30 {
            circle = circle.refined_circle(velocities)?;
        }
        (circle.radius_m_s.is_finite() && circle.wind_m_s.norm().is_finite()).then_some(circle)
    }

    /// Linear least squares of `|v|^2 = 2 w v + k` about the mean.
    fn initial_fit(velocities: &[GroundVelocity]) -> Option<Self> {
        let mean =
            velocities.iter().map(|velocity| velocity.velocity_m_s).sum::<Vector2<f64>>() / velocities.len() as f64;
        let mut fit = LeastSquares::new();
        for velocity in velocities {
            let from = velocity.velocity_m_s - mean;
            fit.add_row(&Vector3::new(2.0 * from.x, 2.0 * from.y, 1.0), from.norm_squared(), 1.0);
        }
        let centre_and_constant = fit.solve()?;
        let centre = centre_and_constant.xy();
        Some(Self {
            wind_m_s: mean + centre,
            radius_m_s: (centre_and_constant.z + centre.norm_squared()).max(0.0).sqrt(),
        })
    }

    /// One Gauss-Newton step on radial distances with Tukey's biweight.
    fn refined_circle(self, velocities: &[GroundVelocity]) -> Option<Self> {
        /// Cut-off of Tukey's biweight per median absolute residual: 4.685 standard deviations.
        const TUKEY_CUTOFF_PER_MAD: f64 = 4.685 * SIGMAS_PER_MEDIAN;
        /// Least median residual, m/s: a receiver's noise.
        const MIN_SCALE_M_S: f64 = 0.1;
        let scale = median(velocities.iter().map(|velocity| self.radial_residual_m_s(velocity).abs()))
            .max(MIN_SCALE_M_S)
            * TUKEY_CUTOFF_PER_MAD;
        let mut fit = LeastSquares::new();
        for velocity in velocities {
            let residual = self.radial_residual_m_s(velocity);
            let weight = square((1.0 - square(residual / scale)).max(0.0));
            let outward = (velocity.velocity_m_s - self.wind_m_s).normalize();
            fit.add_row(&Vector3::new(outward.x, outward.y, 1.0), residual, weight);
        }
        let step = fit.solve()?;
        Some(Self { wind_m_s: self.wind_m_s + step.xy(), radius_m_s: self.radius_m_s + step.z })
    }

    /// Radial residual of a velocity, m/s, outside positive.
    fn radial_residual_m_s(&self, velocity: &GroundVelocity) -> f64 {
        (velocity.velocity_m_s - self.wind_m_s).norm() - self.radius_m_s
    }

    /// Direction of the air velocity, radians from true north.
    fn heading_rad(&self, velocity: &GroundVelocity) -> f64 {
        let air = velocity.velocity_m_s - self.wind_m_s;
        libm::atan2(air.y, air.x)
    }

    /// Standard deviation of a wind component among the parts of the flight, m/s: jackknife standard deviation of the
    /// mean, times the root of the number of parts.
    fn wind_sigma_m_s(velocities: &[GroundVelocity]) -> Option<f64> {
        let mut winds = Vec::new();
        for part in 0..JACKKNIFE_PARTS {
            let [from, to] = [part, part + 1].map(|part| part * velocities.len() / JACKKNIFE_PARTS);
            let other_velocities = [&velocities[..from], &velocities[to..]].concat();
            winds.push(Self::fit_robustly(&other_velocities)?.wind_m_s);
        }
        let mean = winds.iter().sum::<Vector2<f64>>() / JACKKNIFE_PARTS as f64;
        let squares: f64 = winds.iter().map(|wind| (wind - mean).norm_squared()).sum();
        Some((squares * (JACKKNIFE_PARTS - 1) as f64 / 2.0).sqrt())
    }
}

/// Directions of the nose.
struct NoseHeadings {
    integral: HeadingIntegral,
    /// Times of the attitude rows with a bank above `MAX_BANK_DEG`, seconds.
    banked_times_s: Vec<f64>,
}

impl NoseHeadings {
    fn from_flight(flight: &LoggedFlight) -> Option<Self> {
        let integral = HeadingIntegral::new(flight, MAX_GAP_S);
        let banked =
            flight.attitude.rows().iter().filter(|row| wrap_pi(row.row_values[0]).abs().to_degrees() > MAX_BANK_DEG);
        let banked_times_s = banked.map(|row| row.t_s).collect();
        (!integral.is_empty()).then_some(Self { integral, banked_times_s })
    }

    /// Whether the aircraft flies straight around a time.
    fn is_straight(&self, t_s: f64) -> bool {
        let from = self.banked_times_s.partition_point(|at_s| *at_s < t_s - MIN_STRAIGHT_S);
        let is_banked = self.banked_times_s.get(from).is_some_and(|at_s| *at_s <= t_s + MIN_STRAIGHT_S);
        let nose = |by_s: f64| self.integral.heading_rad(t_s + by_s);
        let (Some(before), Some(now), Some(after)) = (nose(-MIN_STRAIGHT_S), nose(0.0), nose(MIN_STRAIGHT_S)) else {
            return false;
        };
        let max_turn_rad = (MAX_TURN_RATE_DEG_S * MIN_STRAIGHT_S).to_radians();
        !is_banked && (now - before).abs() < max_turn_rad && (after - now).abs() < max_turn_rad
    }

    /// Whether the nose turned as the air velocity did, over all turns.
    fn nose_turns_with_velocity(&self, velocities: &[GroundVelocity], circle: &VelocityCircle) -> bool {
        /// Interval over which turns of nose and course are compared, seconds.
        const COMPARISON_INTERVAL_S: f64 = 5.0;
        /// Least turn that is compared, radians.
        const MIN_COMPARED_TURN_RAD: f64 = 0.35;
        /// Largest fraction of the turns by which nose and course may differ.
        const MAX_MISMATCHED_FRACTION: f64 = 0.3;
        let (mut total_rad, mut mismatched_rad) = (0.0, 0.0);
        let mut first = 0;
        for (i, velocity) in velocities.iter().enumerate() {
            // The comparison restarts after a gap, in which whole turns could be missed.
            if i > 0 && velocity.t_s - velocities[i - 1].t_s > MAX_GAP_S {
                first = i;
            }
            if velocity.t_s - velocities[first].t_s < COMPARISON_INTERVAL_S {
                continue;
            }
            let course: f64 = velocities[first..=i]
                .windows(2)
                .map(|pair| f64::from(wrap_pi((circle.heading_rad(&pair[1]) - circle.heading_rad(&pair[0])) as f32)))
                .sum();
            let heading_rad = |velocity: &GroundVelocity| self.integral.heading_rad(velocity.t_s);
            let nose = heading_rad(velocity).zip(heading_rad(&velocities[first])).map(|(to, from)| to - from);
            first = i;
            let Some(nose) = nose else { continue };
            let larger_turn_rad = course.abs().max(nose.abs());
            if larger_turn_rad > MIN_COMPARED_TURN_RAD {
                total_rad += larger_turn_rad;
                mismatched_rad += (course - nose).abs();
            }
        }
        mismatched_rad <= MAX_MISMATCHED_FRACTION * total_rad
    }
}

#[cfg(test)]
mod tests;
