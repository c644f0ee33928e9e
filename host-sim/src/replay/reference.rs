//! What headings can be compared with, and how much that says.

use autoswing::frames::wrap_pi;

use super::course::Course;
use crate::log::Flight;

/// A heading that a log holds, the best first.
#[derive(Clone, Debug, PartialEq)]
pub enum Reference {
    /// The attitude of the simulator that made the log.
    Simulator,
    /// A column of the table.
    Column,
    /// A receiver with two antennas.
    GpsYaw,
    /// A receiver's course in straight flight, less the wind.
    GpsCourse(Course),
    /// The autopilot's own.
    AutopilotYaw,
}

/// References further apart than this are not interpolated between, seconds.
const MAX_GAP_S: f64 = 0.5;

impl Reference {
    /// The best that a log has.
    #[must_use]
    pub fn best(flight: &Flight) -> Option<Self> {
        let has_yaw = |series: &crate::log::series::Series<3>| series.rows().iter().any(|row| row.of[2].is_finite());
        if !flight.truth.is_empty() {
            Some(Self::Simulator)
        } else if !flight.reference.is_empty() {
            Some(Self::Column)
        } else if flight.gps.rows().iter().filter(|row| row.of[5].is_finite()).count() > 20 {
            Some(Self::GpsYaw)
        } else if let Ok(course) = Course::of(flight) {
            Some(Self::GpsCourse(course))
        } else {
            has_yaw(&flight.attitude).then_some(Self::AutopilotYaw)
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Simulator => "the simulator's own attitude",
            Self::Column => "yaw_ref_deg",
            Self::GpsYaw => "GPS yaw",
            Self::GpsCourse(_) => "GPS course in straight flight",
            Self::AutopilotYaw => "the autopilot's yaw",
        }
    }

    /// What it is worth.
    #[must_use]
    pub fn limits(&self) -> String {
        let words = match self {
            Self::Simulator => "exact; used for scoring, nothing else; a real flight has none",
            Self::Column => "as good as whoever made it",
            Self::GpsYaw => "a degree or so, and late by what the receiver takes",
            Self::GpsCourse(course) => return course.limits(),
            Self::AutopilotYaw => {
                "made with a compass, its errors included: this is agreement, not accuracy, and does not decide"
            }
        };
        words.to_owned()
    }

    /// How it was found, where it is GPS course.
    #[must_use]
    pub const fn course(&self) -> Option<&Course> {
        if let Self::GpsCourse(course) = self { Some(course) } else { None }
    }

    /// Whether what differs from it is error.
    #[must_use]
    pub const fn is_accuracy(&self) -> bool {
        !matches!(self, Self::AutopilotYaw)
    }

    /// The heading at an instant, degrees from some north.
    #[must_use]
    pub fn at_deg(&self, flight: &Flight, t_s: f64) -> Option<f64> {
        let heading_rad = match self {
            Self::Simulator => flight.truth.angles_at(t_s, MAX_GAP_S)?[2],
            Self::Column => flight.reference.angles_at(t_s, MAX_GAP_S)?[0],
            Self::GpsCourse(course) => course.at_rad(t_s)?,
            Self::AutopilotYaw => flight.attitude.angles_at(t_s, MAX_GAP_S)?[2],
            Self::GpsYaw => {
                let (before, after, part) = flight.gps.between(t_s, MAX_GAP_S)?;
                let [from, to] = [before.of[5].to_radians(), after.of[5].to_radians()];
                from + part as f32 * wrap_pi(to - from)
            }
        };
        heading_rad.is_finite().then(|| f64::from(heading_rad.to_degrees()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Format;

    /// A receiver that stands still and tells these yaws, degrees, five times a second.
    fn yaws(yaws_deg: &[f32]) -> Flight {
        let mut flight = Flight::new(Format::DataFlash);
        for (i, yaw_deg) in yaws_deg.iter().enumerate() {
            flight.gps.push(i as f64 / 5.0, [48.0, 11.3, 500.0, 0.0, 0.0, *yaw_deg]);
        }
        flight
    }

    /// Two antennas that told a few yaws alone are no reference, and an autopilot that has no yaw is none.
    #[test]
    fn a_reference_is_one_that_is_told() {
        assert_eq!(Reference::best(&yaws(&[90.0; 20])), None);
        assert_eq!(Reference::best(&yaws(&[90.0; 21])), Some(Reference::GpsYaw));
        for (yaw_rad, expected) in [(f32::NAN, None), (1.0, Some(Reference::AutopilotYaw))] {
            let mut flight = Flight::new(Format::Csv);
            flight.attitude.push(0.0, [0.1, 0.2, yaw_rad]);
            assert_eq!(Reference::best(&flight), expected);
        }
    }

    /// Over north the shorter way, and not over a pause.
    #[test]
    fn the_yaw_of_two_antennas_is_interpolated() {
        let mut flight = yaws(&[350.0, 10.0]);
        let north_deg = Reference::GpsYaw.at_deg(&flight, 0.1).unwrap();
        assert!((north_deg.rem_euclid(360.0) + 1.0) % 360.0 < 1.01, "{north_deg}");
        flight.gps.push(1.0, [48.0, 11.3, 500.0, 0.0, 0.0, 10.0]);
        assert_eq!(Reference::GpsYaw.at_deg(&flight, 0.6), None, "between 0.2 and 1 s");
    }
}
