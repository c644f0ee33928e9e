//! Reference headings and their quality.

use autoswing::frames::wrap_pi;
use serde::{Deserialize, Serialize};

use super::gps_course::GpsCourseHeading;

use crate::log::LoggedFlight;

/// Reference heading of a log, best first.
#[derive(Clone, Debug, PartialEq)]
pub enum ReferenceHeading {
    /// True attitude of the simulator that wrote the log.
    Simulator,
    /// Heading column of a table.
    Column,
    /// Yaw of a GPS receiver with two antennas.
    GpsYaw,
    /// GPS course in straight flight, corrected for wind.
    GpsCourse(GpsCourseHeading),
    /// The autopilot's own yaw.
    AutopilotYaw,
}

/// Kind of a reference heading, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferenceKind {
    /// True attitude of a simulator.
    Simulator,
    /// Heading column of a table.
    Column,
    /// Yaw of two antennas.
    GpsYaw,
    /// GPS course in straight flight.
    GpsCourse,
    /// The autopilot's own yaw.
    #[serde(rename = "autopilot")]
    AutopilotYaw,
}

impl ReferenceKind {
    /// All kinds of reference, best first.
    pub const ALL_KINDS: [Self; 5] = [Self::Simulator, Self::Column, Self::GpsYaw, Self::GpsCourse, Self::AutopilotYaw];
}

/// Largest interpolation gap, seconds.
const MAX_GAP_S: f64 = 0.5;

impl ReferenceHeading {
    /// Selects the best reference in a log.
    #[must_use]
    pub fn best_reference(flight: &LoggedFlight) -> Option<Self> {
        ReferenceKind::ALL_KINDS.into_iter().find_map(|reference_kind| Self::of_kind(flight, reference_kind))
    }

    /// The reference of a kind, if the log has it.
    pub fn of_kind(flight: &LoggedFlight, reference_kind: ReferenceKind) -> Option<Self> {
        let gps_yaws = || flight.gps.rows().iter().filter(|row| row.row_values[5].is_finite()).count();
        match reference_kind {
            ReferenceKind::Simulator => (!flight.true_attitude.is_empty()).then_some(Self::Simulator),
            ReferenceKind::Column => (!flight.reference_heading.is_empty()).then_some(Self::Column),
            ReferenceKind::GpsYaw => (gps_yaws() > 20).then_some(Self::GpsYaw),
            ReferenceKind::GpsCourse => GpsCourseHeading::from_flight(flight).ok().map(Self::GpsCourse),
            ReferenceKind::AutopilotYaw => flight.has_yaw().then_some(Self::AutopilotYaw),
        }
    }

    /// Name of the reference.
    #[must_use]
    pub const fn reference_name(&self) -> &'static str {
        match self {
            Self::Simulator => "the simulator's own attitude",
            Self::Column => "yaw_ref_deg",
            Self::GpsYaw => "GPS yaw",
            Self::GpsCourse(_) => "GPS course in straight flight",
            Self::AutopilotYaw => "the autopilot's yaw",
        }
    }

    /// Accuracy of the reference, in words.
    #[must_use]
    pub fn accuracy_description(&self) -> String {
        let limits = match self {
            Self::Simulator => "exact; used for scoring, nothing else; a real flight has none",
            Self::Column => "of unknown accuracy",
            Self::GpsYaw => "a degree or so; its latency is estimated from the body rates where turns show it",
            Self::GpsCourse(course) => return course.accuracy_description(),
            Self::AutopilotYaw => {
                "made with a compass, its errors included: this is agreement, not accuracy, and does not decide"
            }
        };
        limits.to_owned()
    }

    /// The GPS course solution, if used.
    #[must_use]
    pub const fn gps_course_solution(&self) -> Option<&GpsCourseHeading> {
        if let Self::GpsCourse(course) = self { Some(course) } else { None }
    }

    /// Whether a heading's difference from this reference is its error; false for the autopilot's yaw.
    #[must_use]
    pub const fn measures_error(&self) -> bool {
        !matches!(self, Self::AutopilotYaw)
    }

    /// Whether headings count from true north; those of a table may count from any.
    #[must_use]
    pub const fn counts_from_true_north(&self) -> bool {
        !matches!(self, Self::Column)
    }

    /// Standard deviation of a reference that is accurate enough to judge a compass, degrees; of a column it is unknown
    /// and set to zero.
    #[must_use]
    pub fn sigma_if_accurate_deg(&self) -> Option<f64> {
        const MAX_SIGMA_DEG: f64 = 2.0;
        let sigma_deg = match self {
            Self::Simulator | Self::Column => 0.0,
            Self::GpsYaw => 1.0,
            Self::GpsCourse(course) => course.sigma_deg(),
            Self::AutopilotYaw => f64::INFINITY,
        };
        (sigma_deg <= MAX_SIGMA_DEG).then_some(sigma_deg)
    }

    /// Name of the difference between a heading and this reference.
    #[must_use]
    pub const fn difference_name(&self) -> &'static str {
        if self.measures_error() { "error" } else { "disagreement" }
    }

    /// Reference heading at a flight time, degrees.
    #[must_use]
    pub fn heading_deg(&self, flight: &LoggedFlight, t_s: f64) -> Option<f64> {
        let heading_rad = match self {
            Self::Simulator => flight.true_attitude.interpolate_angles(t_s, MAX_GAP_S)?[2],
            Self::Column => flight.reference_heading.interpolate_angles(t_s, MAX_GAP_S)?[0],
            Self::GpsCourse(course) => course.heading_rad(t_s)?,
            Self::AutopilotYaw => flight.attitude.interpolate_angles(t_s, MAX_GAP_S)?[2],
            Self::GpsYaw => {
                let (before, after, weight) = flight.gps.surrounding_rows(t_s, MAX_GAP_S)?;
                let [from, to] = [before.row_values[5].to_radians(), after.row_values[5].to_radians()];
                from + weight as f32 * wrap_pi(to - from)
            }
        };
        heading_rad.is_finite().then(|| f64::from(heading_rad.to_degrees()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::LogFormat;
    use crate::log::time_series::Series;

    /// A receiver at rest with these yaws, degrees, at 5 Hz.
    fn flight_with_yaws(yaws_deg: &[f32]) -> LoggedFlight {
        let mut flight = LoggedFlight::new(LogFormat::DataFlash);
        for (i, yaw_deg) in yaws_deg.iter().enumerate() {
            flight.gps.push_row(i as f64 / 5.0, [48.0, 11.3, 500.0, 0.0, 0.0, *yaw_deg]);
        }
        flight
    }

    /// A few yaws in a log are no reference.
    #[test]
    fn a_reference_heading_needs_valid_yaws() {
        assert_eq!(ReferenceHeading::best_reference(&flight_with_yaws(&[90.0; 10])), None);
        assert_eq!(ReferenceHeading::best_reference(&flight_with_yaws(&[90.0; 40])), Some(ReferenceHeading::GpsYaw));
        for (yaw_rad, expected) in [(f32::NAN, None), (1.0, Some(ReferenceHeading::AutopilotYaw))] {
            let mut flight = LoggedFlight::new(LogFormat::Csv);
            flight.attitude.push_row(0.0, [0.1, 0.2, yaw_rad]);
            assert_eq!(ReferenceHeading::best_reference(&flight), expected);
        }
    }

    /// Yaws of 0.1 rad a second, from 3.0 rad on at 5 Hz, in all series of a log; the best reference is removed in turn.
    #[test]
    fn the_best_reference_gives_its_own_heading() {
        let mut flight = flight_with_yaws(&[f32::NAN; 30]);
        for i in 0..30_u8 {
            let (t_s, turned_rad) = (f64::from(i) / 5.0, f32::from(i) * 0.02);
            flight.attitude.push_row(t_s, [0.1, 0.2, 1.0 + turned_rad]);
            flight.reference_heading.push_row(t_s, [2.0 + turned_rad]);
            flight.true_attitude.push_row(t_s, [0.3, 0.4, 3.0 + turned_rad]);
        }
        let mut headings_rad = Vec::new();
        while let Some(reference) = ReferenceHeading::best_reference(&flight) {
            let heading_deg = reference.heading_deg(&flight, 1.25).unwrap();
            assert_eq!(reference.heading_deg(&flight, 7.0), None, "{reference:?} after the log");
            headings_rad.push((heading_deg - 0.125_f64.to_degrees()).to_radians().rem_euclid(std::f64::consts::TAU));
            match reference {
                ReferenceHeading::Simulator => flight.true_attitude = Series::new(),
                ReferenceHeading::Column => flight.reference_heading = Series::new(),
                _ => flight.attitude = Series::new(),
            }
        }
        assert_eq!(headings_rad.len(), 3);
        for (heading_rad, expected_rad) in headings_rad.into_iter().zip([3.0, 2.0, 1.0]) {
            assert!((heading_rad - expected_rad).abs() < 1e-5, "{heading_rad} {expected_rad}");
        }
    }

    /// A compass is judged by references that are accurate to 2 deg; the autopilot's yaw contains the compass's own errors.
    #[test]
    fn the_autopilots_yaw_is_compared_but_does_not_judge() {
        for (reference, sigma_deg, difference) in [
            (ReferenceHeading::Simulator, Some(0.0), "error"),
            (ReferenceHeading::Column, Some(0.0), "error"),
            (ReferenceHeading::GpsYaw, Some(1.0), "error"),
            (ReferenceHeading::AutopilotYaw, None, "disagreement"),
        ] {
            assert_eq!(reference.sigma_if_accurate_deg(), sigma_deg, "{reference:?}");
            assert_eq!(reference.difference_name(), difference, "{reference:?}");
            let claims_accuracy = !reference.accuracy_description().contains("not accuracy");
            assert_eq!(claims_accuracy, reference.measures_error(), "{reference:?}");
            assert!(reference.gps_course_solution().is_none());
        }
    }

    /// Interpolated across north, but not across a gap.
    #[test]
    fn the_yaw_of_two_antennas_is_interpolated() {
        let mut flight = flight_with_yaws(&[350.0, 10.0]);
        let heading_deg = ReferenceHeading::GpsYaw.heading_deg(&flight, 0.05).unwrap();
        assert!((heading_deg.rem_euclid(360.0) - 355.0).abs() < 1e-3, "{heading_deg}");
        flight.gps.push_row(1.0, [48.0, 11.3, 500.0, 0.0, 0.0, 10.0]);
        assert_eq!(ReferenceHeading::GpsYaw.heading_deg(&flight, 0.6), None, "between 0.2 and 1 s");
    }
}
