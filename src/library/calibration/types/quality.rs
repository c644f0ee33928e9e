//! Methods, expected quality, findings and errors of a solve.

use core::fmt;

use super::coefficients::Orientation;
use super::samples::{CollectionPart, Sample, Samples};
use crate::frames::RollPitch;

/// Expected quality of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quality {
    /// Method of the solution.
    pub method: Method,
    /// Attitudes for which the error is expected.
    pub envelope: AttitudeEnvelope,
    /// Expected heading error (1 sigma), RMS over the envelope, degrees.
    pub expected_rms_deg: f32,
    /// Expected heading error (1 sigma) at the worst heading and bank of the envelope, degrees.
    pub expected_worst_deg: f32,
    /// Robust scale of the norm residual `|h| / F - 1`, dimensionless.
    pub norm_residual: f32,
    /// Robust scale of the inclination residual, degrees.
    pub inclination_residual_deg: f32,
    /// Number of samples in the fit.
    pub samples: u16,
    /// Estimated attitude latency; `None` if unobservable.
    pub latency: Option<AttitudeLatency>,
    /// Whether the inclination is known: determined by the samples, or configured. The ellipsoid method determines
    /// none.
    pub knows_inclination: bool,
}

/// Estimated attitude latency beyond the nominal latency of the attitude source. Negative: the attitude is newer than
/// assumed, or the field older.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AttitudeLatency {
    /// Maximum-likelihood estimate of the latency, seconds.
    pub estimate_s: f32,
    /// Standard deviation of the latency, seconds.
    pub sigma_s: f32,
}

impl Quality {
    /// Whether all twelve coefficients, mounting included, were determined.
    #[must_use]
    pub fn determines_all_coefficients(&self) -> bool {
        self.envelope == AttitudeEnvelope::Banked && self.method != Method::Ellipsoid
    }
}

/// Attitudes of the expected error: twelve headings at each bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum AttitudeEnvelope {
    /// Bank -30, 0 and 30 deg.
    Banked,
    /// Zero bank.
    Level,
}

impl AttitudeEnvelope {
    /// Bank above which a sample belongs to a turn, radians. A calibration without such samples is for level headings
    /// only. Samples of arbitrary attitude are also tested in pitch, because a vehicle that pitches to accelerate also
    /// banks.
    pub const MIN_BANK_RAD: f32 = 10_f32.to_radians();

    pub(in crate::calibration) fn for_samples(method: Method, samples: Samples<'_>) -> Self {
        let has_free_flight_samples = samples.has_free_flight_samples();
        let is_level = |&Sample { attitude: RollPitch { roll_rad, pitch_rad }, .. }: &Sample| {
            roll_rad.abs() < Self::MIN_BANK_RAD && (!has_free_flight_samples || pitch_rad.abs() < Self::MIN_BANK_RAD)
        };
        match method {
            Method::Level => Self::Level,
            // Samples of the ellipsoid method have no attitude to test.
            Method::Ellipsoid => Self::Banked,
            _ if samples.all_samples().all(is_level) => Self::Level,
            _ => Self::Banked,
        }
    }

    pub(in crate::calibration) const fn banks_deg(self) -> &'static [f32] {
        match self {
            Self::Banked => &[-30.0, 0.0, 30.0],
            Self::Level => &[0.0],
        }
    }
}

/// Calibration method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// One ellipse, fitted to level flight.
    Level,
    /// The method of Liu 2007 from a left and a right turn.
    FourEllipse,
    /// Closed form from the planes of a left and a right turn.
    TwoPlane,
    /// Maximum likelihood with per-sample attitude.
    MaximumLikelihood,
    /// Regression on given headings.
    CompassSwing,
    /// Tumbling without attitude.
    Ellipsoid,
}

impl Method {
    /// All methods, in the order of their numbers.
    pub const ALL_METHODS: [Self; 6] =
        [Self::Level, Self::FourEllipse, Self::TwoPlane, Self::MaximumLikelihood, Self::CompassSwing, Self::Ellipsoid];

    /// Name shown to users, in JSON and in `cal solve`.
    #[must_use]
    pub const fn method_name(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::FourEllipse => "four-ellipse",
            Self::TwoPlane => "two-plane",
            Self::MaximumLikelihood => "maximum-likelihood",
            Self::CompassSwing => "compass-swing",
            Self::Ellipsoid => "ellipsoid",
        }
    }

    /// Whether an iterative refinement follows the closed form.
    pub(in crate::calibration) const fn is_refined(self) -> bool {
        matches!(self, Self::MaximumLikelihood | Self::CompassSwing | Self::Ellipsoid)
    }
}

/// Flags of unobservable quantities, which the priors determine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct UnobservableQuantities {
    /// Whether soft iron in some direction is unobservable.
    pub soft_iron: bool,
    /// Whether the mounting about some axis is unobservable.
    pub mounting: bool,
    /// Whether hard iron along some axis is unobservable.
    pub hard_iron: bool,
}

/// Finding: bank-angle scale error of an attitude source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankScaleFinding {
    /// Ratio of reported to true bank; 1 is correct.
    pub reported_bank_ratio: f32,
    /// Distance from 1 in sigmas, the allowance for good sources included.
    pub significance_sigmas: f32,
}

/// Constant errors of the attitude source, 1 sigma: consider states. Turns do not reveal them, because a bias acts like
/// a mounting error and a bank-angle scale error like soft iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConsiderSigmas {
    /// Constant roll and pitch bias, radians; 0.2 deg for a carefully levelled autopilot.
    pub bias_rad: f32,
    /// Bank-angle scale error in turns, dimensionless; 1 % for an attitude filter that uses airspeed.
    pub bank_scale: f32,
    /// Share of the pitch that the roll has in addition, and of the roll that the pitch has, dimensionless: the cross-axis
    /// sensitivity of a gyro that measures them. It turns the heading by about this angle.
    pub cross_axis: f32,
}

impl ConsiderSigmas {
    /// Standard deviations of the attitude errors of a good autopilot.
    pub const DEFAULT: Self = Self { bias_rad: 0.0035, bank_scale: 0.01, cross_axis: 0.0 };

    /// Error-free attitude source.
    pub const ZERO: Self = Self { bias_rad: 0.0, bank_scale: 0.0, cross_axis: 0.0 };
}

/// Time course of a hard-iron change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HardIronTimeCourse {
    /// Sudden change.
    Step {
        /// Time of the last sample before the change, after the first sample, milliseconds.
        after_ms: u32,
    },
    /// Linear change from the first sample to the last.
    Drift,
    /// Change with the load factor less one, as the deflection of the elevator: iron in its linkage. Constant above 25
    /// deg of bank.
    LoadFactor,
    /// Lag of the soft iron's field behind turns: hysteresis.
    Hysteresis,
}

/// A hard-iron change during a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedHardIronChange {
    /// Size of the change, microtesla.
    pub size_ut: f32,
    /// Time course of the change.
    pub time_course: HardIronTimeCourse,
    /// Time from the first sample to the last, milliseconds.
    pub duration_ms: u32,
}

impl fmt::Display for DetectedHardIronChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The cast saturates and maps NaN to 0.
        let (tenths, of_s) = ((self.size_ut * 10.0 + 0.5) as u32, self.duration_ms / 1000);
        let (whole, tenth) = (tenths / 10, tenths % 10);
        match self.time_course {
            HardIronTimeCourse::Step { after_ms } => {
                write!(f, "iron changed by {whole}.{tenth} uT after {} of {of_s} s", after_ms / 1000)
            }
            HardIronTimeCourse::Drift => write!(f, "iron drifted by {whole}.{tenth} uT in {of_s} s"),
            HardIronTimeCourse::LoadFactor => write!(f, "iron moves by {whole}.{tenth} uT with the elevator in turns"),
            HardIronTimeCourse::Hysteresis => write!(f, "iron of {whole}.{tenth} uT lags behind turns (hysteresis)"),
        }
    }
}

/// An axis of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// x axis of the chip.
    X,
    /// y axis of the chip.
    Y,
    /// z axis of the chip.
    Z,
}

impl Axis {
    /// Lower-case letter of the axis.
    #[must_use]
    pub const fn axis_name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// Reason for a failed solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SolveError {
    /// A part has fewer samples than any solution needs.
    TooFewSamples {
        /// Part of the collection that lacks samples, such as its left turns.
        part: CollectionPart,
        /// Number of samples in the part.
        have: u16,
        /// Required number of samples.
        need: u16,
    },
    /// A sample has a non-finite value.
    NotFinite,
    /// Level samples cover too few headings.
    TooFewHeadings {
        /// Number of headings covered, of twelve.
        have: u8,
        /// Required number of headings.
        need: u8,
    },
    /// An axis of the sensor stays at one end of its range.
    AxisStuck {
        /// Chip axis.
        axis: Axis,
    },
    /// The samples of a part are not on an ellipse: too short an arc, or not a turn.
    NotAnEllipse(CollectionPart),
    /// The samples do not determine the coefficients.
    NotDetermined(CollectionPart),
    /// Both sides have nearly the same bank, so their planes do not intersect.
    SamePlane,
    /// The hard iron changed so much that no plausible fit exists.
    HardIronChanged(DetectedHardIronChange),
    /// No starting point led to an acceptable fit.
    NotConverged,
    /// Headings run against the turns: the attitude source's roll has the wrong sign.
    TurnsReversed,
    /// The configured inclination contradicts the samples.
    InclinationContradicted {
        /// Inclination of the samples, degrees, positive down.
        found_deg: i8,
    },
    /// The configured mounting contradicts the samples.
    MountContradicted {
        /// Right-angle mounting nearest to the fit.
        found: Orientation,
    },
}

impl SolveError {
    /// Error of a part with too few samples; numbers saturate at 65,535.
    pub(in crate::calibration) fn too_few(part: CollectionPart, have: usize, need: usize) -> Self {
        let [have, need] = [have, need].map(|number| u16::try_from(number).unwrap_or(u16::MAX));
        Self::TooFewSamples { part, have, need }
    }

    ///
    /// # Errors
    ///
    /// [`SolveError::TooFewSamples`] when `have < need`.
    pub(in crate::calibration) fn require_samples(part: CollectionPart, have: usize, need: usize) -> Result<(), Self> {
        if have < need { Err(Self::too_few(part, have, need)) } else { Ok(()) }
    }
}

impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewSamples { part, have, need } => write!(f, "{have} of {need} samples of {}", part.part_name()),
            Self::NotFinite => f.write_str("a sample is not a finite number"),
            Self::TooFewHeadings { have, need } => write!(f, "{have} of {need} headings, 30 deg apart"),
            Self::AxisStuck { axis } => write!(f, "the sensor's {} axis is saturated or stuck", axis.axis_name()),
            Self::NotAnEllipse(part) => write!(f, "the {} are no full circle", part.part_name()),
            Self::NotDetermined(part) => {
                write!(f, "the samples of {} do not determine the coefficients", part.part_name())
            }
            Self::SamePlane => f.write_str("left and right bank differ too little"),
            Self::HardIronChanged(change) => change.fmt(f),
            Self::NotConverged => f.write_str("no coefficients explain the samples"),
            Self::TurnsReversed => f.write_str("the headings run against the turns"),
            Self::InclinationContradicted { found_deg } => {
                write!(f, "the samples show an inclination of {found_deg} deg")
            }
            Self::MountContradicted { found } => {
                write!(f, "the sensor seems to be mounted {}", found.orientation_name())
            }
        }
    }
}

impl core::error::Error for SolveError {}

#[cfg(test)]
mod error_tests {
    use super::*;

    #[test]
    fn a_part_one_sample_short_is_rejected() {
        assert_eq!(SolveError::require_samples(CollectionPart::LEVEL, 8, 8), Ok(()));
        let missing = SolveError::TooFewSamples { part: CollectionPart::LEVEL, have: 7, need: 8 };
        assert_eq!(SolveError::require_samples(CollectionPart::LEVEL, 7, 8), Err(missing));
        let saturated = SolveError::TooFewSamples { part: CollectionPart::FREE, have: u16::MAX, need: u16::MAX };
        assert_eq!(SolveError::too_few(CollectionPart::FREE, 65_536, 70_000), saturated);
    }
}
