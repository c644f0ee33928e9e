//! True heading in straight flight from velocities over ground: what a satellite receiver knows, and no compass.
//!
//! Velocity over ground is velocity through the air plus wind. At a constant airspeed the velocities of a flight in several
//! directions lie on a circle about the wind. The circle is fitted to velocities alone: wind could be solved from headings,
//! too, but a hard iron's error of one cycle a turn looks just as wind does, and would be taken for it. The nose of what
//! flies on wings points where it moves through the air, but for sideslip.
//!
//! A receiver is late by what it takes, and nobody logs how much. In straight flight that does not matter.

use autoswing::attitude::{Motion, Report, Source};
use autoswing::frames::{Attitude, wrap_pi};
use autoswing::time::WrappingMillis;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::judge::median;
use crate::log::series::Series;
use crate::log::{Flight, Gps};

/// Banked by more, degrees, it does not fly straight: gusts roll by a few. No more for so long before and after, seconds:
/// receivers are late by 0.1 to 0.4 s, and a roll-out takes a second.
const MAX_BANK_DEG: f32 = 10.0;
const STRAIGHT_S: f64 = 2.0;

/// Nor does it if it turns by more on the mean of that, degrees a second; single readings of gyros vibrate.
const MAX_TURN_DEG_S: f64 = 3.0;

/// Velocities and attitudes further apart are not interpolated between, seconds: over MAVLink they come once a second.
const MAX_GAP_S: f64 = 1.5;

/// Slower than this, m/s, or than this share of what is nearly its fastest, it taxies, hovers or lands: at half an airspeed
/// of wind a third is left upwind.
const MIN_SPEED_M_S: f64 = 4.0;
const MIN_SPEED_SHARE: f64 = 0.3;

/// Least airspeed, m/s, and least ratio of it to the wind: what is slower steers sideways, drifts, or is no aeroplane.
const MIN_AIRSPEED_M_S: f64 = 8.0;
const MIN_AIRSPEED_BY_WIND: f64 = 2.0;

/// What is further from the circle, as a share of airspeed, does not fly as the rest does; so much may be.
const MAX_OFF: f64 = 0.15;
const MIN_ON_CIRCLE: f64 = 0.7;

/// Largest standard deviation of the wind, by airspeed: 2.9 deg of heading.
const MAX_WIND_SIGMA: f64 = 0.05;

/// A direction is flown in if for so long, seconds, and neighbouring ones are no further apart than this, degrees: out and
/// back alone shows one cycle of error a turn on one axis only.
const IN_DIRECTION_S: f64 = 3.0;
const MAX_GAP_DEG: f64 = 150.0;

/// Sideslip, which nothing in a log shows: assumed, degrees. Gusts of 0.5 m/s across at 20 m/s.
const SIDESLIP_DEG: f64 = 1.5;

/// The flight without one of so many parts of it says how the wind changed: gusts last, and wind drifts.
const PARTS: usize = 10;

/// Headings in straight flight, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// The wind's velocity towards true north and east, m/s.
    pub wind_m_s: [f64; 2],
    /// Standard deviation of a component of it, as it is in a tenth of the flight.
    pub wind_sigma_m_s: f64,
    /// Airspeed, as far as it is level, m/s.
    pub airspeed_m_s: f64,
    /// RMS distance of straight flight from the circle, m/s.
    pub scatter_m_s: f64,
    /// The widest angle between neighbouring directions of straight flight, degrees.
    pub widest_gap_deg: f64,
    /// True headings while it flew straight, radians.
    heading: Series<1>,
}

/// Why course says nothing of the heading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoCourse {
    /// No velocity over ground is logged.
    NotLogged,
    /// It flies on rotors.
    Copter,
    /// Without body rates nobody knows whether the nose turns as the course does.
    NoRates,
    /// It never flew fast enough.
    Slow,
    /// Velocities lie on no circle.
    NoCircle,
    /// The wind is strong, by airspeed.
    Windy,
    /// It did not fly straight in directions all round.
    FewDirections,
    /// The wind is known too badly.
    UncertainWind,
    /// The nose turns otherwise than the course.
    NoseElsewhere,
}

impl NoCourse {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::NotLogged => "no velocity over ground is logged",
            Self::Copter => "a copter's nose need not point where it flies",
            Self::NoRates => "no body rates are logged to tell whether the nose turns as the course does",
            Self::Slow => "it never flew fast enough",
            Self::NoCircle => "velocities over ground lie on no circle about a wind: airspeed or wind changed",
            Self::Windy => "the wind was more than half of the airspeed",
            Self::FewDirections => "it did not fly straight in three directions or more all round",
            Self::UncertainWind => "the wind is not certain enough: it changed, or too few directions were flown",
            Self::NoseElsewhere => "the nose did not turn as the course did",
        }
    }
}

/// Where a velocity over ground was measured.
#[derive(Clone, Copy, Debug)]
struct Velocity {
    t_s: f64,
    /// Towards true north and east.
    m_s: Vector2<f64>,
}

impl Course {
    /// What the velocities of a flight give.
    ///
    /// # Errors
    ///
    /// Why they give nothing.
    pub fn of(flight: &Flight) -> Result<Self, NoCourse> {
        let velocities = velocities(flight);
        if velocities.is_empty() {
            return Err(NoCourse::NotLogged);
        }
        if flight.is_copter {
            return Err(NoCourse::Copter);
        }
        let moving = moving(velocities).ok_or(NoCourse::Slow)?;
        let fitted = thinned(&moving);
        let circle = Circle::through(&fitted).ok_or(NoCourse::NoCircle)?;
        let flown = on_circle(&moving, &circle)?;
        let turned = Turned::of(flight).ok_or(NoCourse::NoRates)?;
        let straight: Vec<Velocity> = flown.iter().filter(|v| turned.is_straight(v.t_s)).copied().collect();
        let course = Self::by(&circle, &fitted, &straight)?;
        if !turned.follows(&flown, &circle) {
            return Err(NoCourse::NoseElsewhere);
        }
        Ok(course)
    }

    /// Of straight flight by a circle, fitted to these velocities, if that is good enough.
    fn by(circle: &Circle, fitted: &[Velocity], straight: &[Velocity]) -> Result<Self, NoCourse> {
        let airspeed_m_s = circle.radius_m_s;
        let widest_gap_deg = widest_gap_deg(straight, circle);
        if widest_gap_deg > MAX_GAP_DEG {
            return Err(NoCourse::FewDirections);
        }
        let squares: f64 = straight.iter().map(|v| circle.off(v).powi(2)).sum();
        let scatter_m_s = (squares / straight.len() as f64).sqrt();
        if airspeed_m_s < MIN_AIRSPEED_BY_WIND * circle.wind_m_s.norm() {
            return Err(NoCourse::Windy);
        }
        let wind_sigma_m_s = Circle::wind_sigma_m_s(fitted).ok_or(NoCourse::UncertainWind)?;
        if wind_sigma_m_s > MAX_WIND_SIGMA * airspeed_m_s {
            return Err(NoCourse::UncertainWind);
        }
        let mut heading = Series::new();
        for v in straight {
            heading.push(v.t_s, [circle.heading_rad(v) as f32]);
        }
        let wind_m_s = circle.wind_m_s.into();
        Ok(Self { wind_m_s, wind_sigma_m_s, airspeed_m_s, scatter_m_s, widest_gap_deg, heading })
    }

    /// True heading at an instant of straight flight, radians.
    #[must_use]
    pub fn at_rad(&self, t_s: f64) -> Option<f32> {
        self.heading.angles_at(t_s, MAX_GAP_S).map(|[heading_rad]| heading_rad)
    }

    /// Speed of the wind, m/s.
    #[must_use]
    pub fn wind_speed_m_s(&self) -> f64 {
        self.wind_m_s[0].hypot(self.wind_m_s[1])
    }

    /// Where the wind comes from, degrees from true north.
    #[must_use]
    pub fn wind_from_deg(&self) -> f64 {
        (-self.wind_m_s[1]).atan2(-self.wind_m_s[0]).to_degrees().rem_euclid(360.0)
    }

    /// What it is worth.
    #[must_use]
    pub fn limits(&self) -> String {
        format!(
            "no compass is in it: ground velocity less a wind of {:.1} m/s from {:.0} deg true, which the velocities \
             themselves show; {:.1} m/s through the air, scatter {:.1}. Its own sigma, which is in the figures, is up to \
             {:.1} deg: {:.1} of the wind as it changed in the flight, {SIDESLIP_DEG} assumed for sideslip. It says \
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

    /// Standard deviation of a heading, degrees: the wind's, and sideslip, which is assumed. Airspeed that changes scatters
    /// velocities along the heading and is not in it.
    #[must_use]
    pub fn sigma_deg(&self) -> f64 {
        self.wind_sigma_deg().hypot(SIDESLIP_DEG)
    }

    /// What the wind's standard deviation makes of headings, degrees.
    fn wind_sigma_deg(&self) -> f64 {
        (self.wind_sigma_m_s / self.airspeed_m_s).to_degrees()
    }
}

fn velocities(flight: &Flight) -> Vec<Velocity> {
    let of = |row: &crate::log::series::Stamped<6>| {
        let Gps { speed_m_s, course_deg, .. } = Gps::from_columns(row.of);
        let (sin, cos) = f64::from(course_deg).to_radians().sin_cos();
        let m_s = Vector2::new(cos, sin) * f64::from(speed_m_s);
        (m_s.x.is_finite() && m_s.y.is_finite()).then_some(Velocity { t_s: row.t_s, m_s })
    };
    flight.gps.rows().iter().filter_map(of).collect()
}

/// Those in flight; none where it was hardly flown.
fn moving(velocities: Vec<Velocity>) -> Option<Vec<Velocity>> {
    const MIN_NUMBER: usize = 30;
    let mut speeds: Vec<f64> = velocities.iter().map(|v| v.m_s.norm()).filter(|m_s| *m_s > MIN_SPEED_M_S).collect();
    speeds.sort_by(f64::total_cmp);
    let fast_m_s = *speeds.get(speeds.len() * 9 / 10)?;
    let least_m_s = MIN_SPEED_M_S.max(MIN_SPEED_SHARE * fast_m_s);
    let moving: Vec<Velocity> = velocities.into_iter().filter(|v| v.m_s.norm() > least_m_s).collect();
    (moving.len() >= MIN_NUMBER).then_some(moving)
}

/// Those that fly as fast as most of them do.
fn on_circle(moving: &[Velocity], circle: &Circle) -> Result<Vec<Velocity>, NoCourse> {
    let airspeed_m_s = circle.radius_m_s;
    if airspeed_m_s < MIN_AIRSPEED_M_S {
        return Err(NoCourse::Slow);
    }
    let flown: Vec<Velocity> =
        moving.iter().filter(|v| circle.off(v).abs() < MAX_OFF * airspeed_m_s).copied().collect();
    let is_most = flown.len() as f64 >= MIN_ON_CIRCLE * moving.len() as f64;
    is_most.then_some(flown).ok_or(NoCourse::NoCircle)
}

/// Not more of them than a fit needs.
fn thinned(velocities: &[Velocity]) -> Vec<Velocity> {
    const MAX_NUMBER: usize = 5000;
    velocities.iter().step_by(velocities.len().div_ceil(MAX_NUMBER).max(1)).copied().collect()
}

/// The widest angle between neighbouring directions of straight flight, degrees; a whole turn where there are none.
fn widest_gap_deg(straight: &[Velocity], circle: &Circle) -> f64 {
    const BINS: usize = 72;
    const BIN_DEG: f64 = 360.0 / BINS as f64;
    let mut flown_s = [0.0; BINS];
    for pair in straight.windows(2) {
        let bin = (circle.heading_rad(&pair[0]).to_degrees().rem_euclid(360.0) / BIN_DEG) as usize % BINS;
        let step_s = pair[1].t_s - pair[0].t_s;
        flown_s[bin] += if step_s < MAX_GAP_S { step_s } else { 0.0 };
    }
    // A direction is flown in by what is within a bin of it: gusts scatter a leg over a few.
    let is_flown = |bin: usize| {
        let around = [BINS - 1, 0, 1].map(|by| flown_s[(bin + by) % BINS]);
        flown_s[bin % BINS] > 0.0 && around.iter().sum::<f64>() >= IN_DIRECTION_S
    };
    let (mut empty, mut widest) = (0, 0);
    for bin in 0..2 * BINS {
        empty = if is_flown(bin) { 0 } else { empty + 1 };
        widest = widest.max(empty + 1);
    }
    (f64::from(widest) * BIN_DEG).min(360.0)
}

/// Velocities over ground at one airspeed in one wind.
#[derive(Clone, Copy, Debug)]
struct Circle {
    wind_m_s: Vector2<f64>,
    radius_m_s: f64,
}

impl Circle {
    /// The circle nearest to most velocities: what is far from it counts for less and less.
    fn through(velocities: &[Velocity]) -> Option<Self> {
        let mut circle = Self::roughly(velocities)?;
        for _ in 0..30 {
            circle = circle.nearer(velocities)?;
        }
        (circle.radius_m_s.is_finite() && circle.wind_m_s.norm().is_finite()).then_some(circle)
    }

    /// By least squares of `|v|^2 = 2 w v + k`, about their mean.
    fn roughly(velocities: &[Velocity]) -> Option<Self> {
        let mean = velocities.iter().map(|v| v.m_s).sum::<Vector2<f64>>() / velocities.len() as f64;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for v in velocities {
            let from = v.m_s - mean;
            let row = Vector3::new(2.0 * from.x, 2.0 * from.y, 1.0);
            normal += row * row.transpose();
            right += row * from.norm_squared();
        }
        let found = normal.cholesky()?.solve(&right);
        let centre = found.xy();
        Some(Self { wind_m_s: mean + centre, radius_m_s: (found.z + centre.norm_squared()).max(0.0).sqrt() })
    }

    /// One step of Gauss and Newton on distances, with Tukey's weights.
    fn nearer(self, velocities: &[Velocity]) -> Option<Self> {
        /// Of the median distance for weights that end, and the least scale: a receiver's noise, m/s.
        const ENDS: f64 = 4.685 * 1.4826;
        const LEAST_M_S: f64 = 0.1;
        let scale = median(velocities.iter().map(|v| self.off(v).abs()).collect()).max(LEAST_M_S) * ENDS;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for v in velocities {
            let off = self.off(v);
            let weight = (1.0 - (off / scale).powi(2)).max(0.0).powi(2);
            let out = (v.m_s - self.wind_m_s).normalize();
            let row = Vector3::new(out.x, out.y, 1.0);
            normal += row * row.transpose() * weight;
            right += row * (off * weight);
        }
        let step = normal.cholesky()?.solve(&right);
        Some(Self { wind_m_s: self.wind_m_s + step.xy(), radius_m_s: self.radius_m_s + step.z })
    }

    /// How far outside a velocity is, m/s.
    fn off(&self, velocity: &Velocity) -> f64 {
        (velocity.m_s - self.wind_m_s).norm() - self.radius_m_s
    }

    /// Direction through the air, radians from true north.
    fn heading_rad(&self, velocity: &Velocity) -> f64 {
        let air = velocity.m_s - self.wind_m_s;
        air.y.atan2(air.x)
    }

    /// Standard deviation of a component of the wind from part to part of the flight, by leaving out each in turn: the
    /// jackknife's of their mean, times the root of their number.
    fn wind_sigma_m_s(velocities: &[Velocity]) -> Option<f64> {
        let mut winds = Vec::new();
        for part in 0..PARTS {
            let [from, to] = [part, part + 1].map(|part| part * velocities.len() / PARTS);
            let rest = [&velocities[..from], &velocities[to..]].concat();
            winds.push(Self::through(&rest)?.wind_m_s);
        }
        let mean = winds.iter().sum::<Vector2<f64>>() / PARTS as f64;
        let squares: f64 = winds.iter().map(|wind| (wind - mean).norm_squared()).sum();
        Some((squares * (PARTS - 1) as f64 / 2.0).sqrt())
    }
}

/// How the nose turned, by the gyros, and when it was banked.
struct Turned {
    /// Seconds and the integral of the heading's rate, radians.
    nose: Vec<(f64, f64)>,
    /// When it was banked, seconds.
    banked_s: Vec<f64>,
}

impl Turned {
    fn of(flight: &Flight) -> Option<Self> {
        let (mut nose, mut banked_s) = (Vec::new(), Vec::new());
        let mut last: Option<(f64, f64, f64)> = None;
        for row in flight.attitude.rows() {
            let [roll_rad, pitch_rad, _] = row.of;
            let Some(rates_rad_s) = flight.rates.at(row.t_s, MAX_GAP_S) else { continue };
            let (source, sender_time) = (Source::default(), WrappingMillis::default());
            let attitude = Attitude { roll_rad, pitch_rad };
            let Some(motion) = Motion::of(&Report { source, sender_time, attitude, rates_rad_s }) else { continue };
            if wrap_pi(roll_rad).abs().to_degrees() > MAX_BANK_DEG {
                banked_s.push(row.t_s);
            }
            let rate = f64::from(motion.heading_rad_s);
            let turned = last.map_or(0.0, |(t_s, turned, before)| turned + rate.midpoint(before) * (row.t_s - t_s));
            nose.push((row.t_s, turned));
            last = Some((row.t_s, turned, rate));
        }
        (!nose.is_empty()).then_some(Self { nose, banked_s })
    }

    /// Whether it flies straight, with attitudes that say so, for a while before and after.
    fn is_straight(&self, t_s: f64) -> bool {
        let from = self.banked_s.partition_point(|at_s| *at_s < t_s - STRAIGHT_S);
        let is_banked = self.banked_s.get(from).is_some_and(|at_s| *at_s <= t_s + STRAIGHT_S);
        let nose = |by_s: f64| self.at_rad(t_s + by_s);
        let (Some(before), Some(now), Some(after)) = (nose(-STRAIGHT_S), nose(0.0), nose(STRAIGHT_S)) else {
            return false;
        };
        let most = (MAX_TURN_DEG_S * STRAIGHT_S).to_radians();
        !is_banked && (now - before).abs() < most && (after - now).abs() < most
    }

    /// How far the nose had turned.
    fn at_rad(&self, t_s: f64) -> Option<f64> {
        let after = self.nose.partition_point(|(at_s, _)| *at_s <= t_s);
        let (&(from_s, from), &(to_s, to)) = (self.nose.get(after.checked_sub(1)?)?, self.nose.get(after)?);
        (to_s - from_s < MAX_GAP_S).then(|| from + (to - from) * (t_s - from_s) / (to_s - from_s))
    }

    /// Whether the nose turned as the direction through the air did, wherever either did so.
    fn follows(&self, flown: &[Velocity], circle: &Circle) -> bool {
        /// Over so long, seconds, by so much at the least, radians, and so much of it may be otherwise.
        const OVER_S: f64 = 5.0;
        const LEAST_RAD: f64 = 0.35;
        const MAX_OTHERWISE: f64 = 0.3;
        let (mut all, mut otherwise) = (0.0, 0.0);
        let mut first = 0;
        for (i, v) in flown.iter().enumerate() {
            // The direction counts whole turns if none is skipped, and half a second is no half turn.
            if i > 0 && v.t_s - flown[i - 1].t_s > MAX_GAP_S {
                first = i;
            }
            if v.t_s - flown[first].t_s < OVER_S {
                continue;
            }
            let course: f64 = flown[first..=i]
                .windows(2)
                .map(|pair| f64::from(wrap_pi((circle.heading_rad(&pair[1]) - circle.heading_rad(&pair[0])) as f32)))
                .sum();
            let nose = self.at_rad(v.t_s).zip(self.at_rad(flown[first].t_s)).map(|(to, from)| to - from);
            first = i;
            let Some(nose) = nose else { continue };
            let most = course.abs().max(nose.abs());
            if most > LEAST_RAD {
                all += most;
                otherwise += (course - nose).abs();
            }
        }
        otherwise <= MAX_OTHERWISE * all
    }
}

#[cfg(test)]
mod tests;
