//! Axes of the attitude that ArduPlane logs of a quadplane or tailsitter.
//!
//! `ATT` and `ATTITUDE` are those of a view in VTOL modes: turned by 90 deg on tailsitters, and by `Q_TRIM_PITCH`, while
//! the compass is fixed to the body. In forward flight `ATTITUDE` is less the trim of fixed-wing flight.

use std::fmt;

use nalgebra::Rotation3;

use super::parameters::ParameterHistory;
use super::time_series::{Series, TimedRow};

/// Reason why the view of VTOL modes may differ from the attitude of the body; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VtolView {
    /// A tailsitter's nose points up in hover.
    Tailsitter,
    /// A parameter that trims pitch in some modes is not zero.
    Trimmed(&'static str),
    /// A parameter that trims pitch, or shows the kind of the aircraft, is not in the log.
    Unknown(&'static str),
}

impl VtolView {
    /// Whether the logged attitude is a view that may differ from the body; none if it is that of the body.
    pub(super) fn of_log(parameters: &ParameterHistory, is_telemetry: bool) -> Option<Self> {
        /// ArduPilot's frame class of tailsitters.
        const TAILSITTER_FRAME_CLASS: f64 = 10.0;
        let value = |name: &str| parameters.last_value(name);
        if !value("Q_ENABLE").is_some_and(|enabled| enabled != 0.0) {
            return None;
        }
        // Until 4.0 a tailsitter has motors for its hover, or its frame class.
        let tailsitter = value("Q_TAILSIT_ENABLE").or_else(|| value("Q_TAILSIT_MOTMX"));
        if value("Q_FRAME_CLASS") == Some(TAILSITTER_FRAME_CLASS) || tailsitter.is_some_and(|enabled| enabled != 0.0) {
            return Some(Self::Tailsitter);
        }
        if tailsitter.is_none() {
            return Some(Self::Unknown("Q_TAILSIT_ENABLE"));
        }
        // MAVLink takes the trim of fixed-wing flight off, too; its names since 4.5, and before.
        let forward_trims = ["PTCH_TRIM_DEG", "TRIM_PITCH_CD"];
        let trims = ["Q_TRIM_PITCH"].into_iter().chain(forward_trims.into_iter().filter(|_| is_telemetry));
        let is_trimmed = |name: &&'static str| {
            value(name).is_some_and(|trim| trim != 0.0) || parameters.last_change_s(name).is_some()
        };
        match trims.clone().find(is_trimmed) {
            Some(name) => Some(Self::Trimmed(name)),
            None if value("Q_TRIM_PITCH").is_none() => Some(Self::Unknown("Q_TRIM_PITCH")),
            None if is_telemetry && forward_trims.into_iter().all(|name| value(name).is_none()) => {
                Some(Self::Unknown("PTCH_TRIM_DEG"))
            }
            None => None,
        }
    }
}

/// Pitch of the body less that of the logged attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ViewTrims {
    /// In forward flight, radians.
    forward_rad: f64,
    /// In VTOL modes, radians.
    hover_rad: f64,
}

impl ViewTrims {
    /// The trims of a log; none if a parameter is missing, or changed in flight: firmware differs in when it takes effect.
    pub(super) fn of_log(parameters: &ParameterHistory, is_telemetry: bool) -> Option<Self> {
        /// `FLIGHT_OPTIONS` of ArduPlane: `ATTITUDE` is not less the trim.
        const WITH_FORWARD_TRIM: u32 = 1 << 8;
        let value = |name: &str| parameters.last_value(name).filter(|_| parameters.last_change_s(name).is_none());
        let options = value("FLIGHT_OPTIONS").unwrap_or(0.0) as u32;
        let forward_deg = if !is_telemetry || options & WITH_FORWARD_TRIM != 0 {
            0.0
        } else {
            value("PTCH_TRIM_DEG").or_else(|| Some(0.01 * value("TRIM_PITCH_CD")?))?
        };
        let tailsitter_deg = match VtolView::of_log(parameters, is_telemetry)? {
            VtolView::Tailsitter => 90.0,
            VtolView::Trimmed(_) => 0.0,
            VtolView::Unknown(_) => return None,
        };
        let hover_deg = value("Q_TRIM_PITCH")? + tailsitter_deg;
        Some(Self { forward_rad: forward_deg.to_radians(), hover_rad: hover_deg.to_radians() })
    }

    /// The attitude of the body where the mode shows the view; none if that is less than half of the log.
    pub(super) fn body_attitude(self, logged: &Series<3>, flight_modes: &Series<1>) -> Option<Series<3>> {
        let mut views: Vec<(f64, Option<bool>)> = Vec::new();
        for row in flight_modes.rows() {
            let hovers = is_hover(row.row_values[0]);
            if views.last().is_none_or(|(_, last)| *last != hovers) {
                views.push((row.t_s, hovers));
            }
        }
        let mut body = Series::new();
        for row in logged.rows() {
            // The first mode is reported some time after the begin of a log.
            let index = views.partition_point(|(from_s, _)| *from_s <= row.t_s).saturating_sub(1);
            let Some(&(from_s, Some(hovers))) = views.get(index) else { continue };
            if index == 0 || row.t_s - from_s > MAX_TRANSITION_S {
                body.push_row(row.t_s, self.body_angles(row, hovers));
            }
        }
        (2 * body.rows().len() >= logged.rows().len() && !body.is_empty()).then_some(body)
    }

    /// Roll, pitch and yaw of the body. `ATTITUDE` is less a number of its pitch; a view is a rotation.
    fn body_angles(self, logged: &TimedRow<3>, hovers: bool) -> [f32; 3] {
        let [roll, pitch, yaw] = logged.row_values.map(f64::from);
        if !hovers {
            return [roll, pitch + self.forward_rad, yaw].map(|angle| angle as f32);
        }
        let known_yaw = if yaw.is_nan() { 0.0 } else { yaw };
        let view = Rotation3::from_euler_angles(roll, pitch, known_yaw);
        let (roll, pitch, yaw_of_body) = (view * Rotation3::from_euler_angles(0.0, self.hover_rad, 0.0)).euler_angles();
        [roll, pitch, yaw_of_body + yaw - known_yaw].map(|angle| angle as f32)
    }
}

/// Longest transition after a change of the mode, seconds, in which a tailsitter's or tiltrotor's view is the former one.
const MAX_TRANSITION_S: f64 = 15.0;

/// Whether a mode of ArduPlane shows the view of VTOL modes; none of `AUTO`, `RTL`, `GUIDED` and others that may hover.
fn is_hover(mode: f32) -> Option<bool> {
    match mode as u8 {
        // MANUAL to CRUISE and AUTOTUNE, LOITER, TAKEOFF, THERMAL.
        0..=8 | 12 | 13 | 24 => Some(false),
        // QSTABILIZE, QHOVER, QLOITER, QLAND, QAUTOTUNE, QACRO.
        17..=20 | 22 | 23 => Some(true),
        _ => None,
    }
}

impl fmt::Display for VtolView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tailsitter => f.write_str("the attitude of a tailsitter is turned by 90 deg in hover"),
            Self::Trimmed(name) => write!(f, "{name} trims the attitude in some modes of a VTOL, and not in others"),
            Self::Unknown(name) => {
                write!(f, "{name} is not in the log, by which the attitude of a VTOL may be trimmed")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last value of `PTCH_TRIM_DEG` concerns telemetry alone. A trim that changed in flight is another before.
    #[test]
    fn the_view_is_that_of_the_body_if_parameters_show_it() {
        let quadplane = [("Q_ENABLE", 1.0), ("Q_FRAME_CLASS", 1.0), ("Q_TAILSIT_ENABLE", 0.0), ("Q_TRIM_PITCH", 0.0)];
        let trim = |deg: f64| ("PTCH_TRIM_DEG", deg);
        for (changes, in_dataflash, in_telemetry) in [
            (&[trim(0.0)][..], None, None),
            (&[], None, Some(VtolView::Unknown("PTCH_TRIM_DEG"))),
            (&[trim(2.0)], None, Some(VtolView::Trimmed("PTCH_TRIM_DEG"))),
            (
                &[("Q_TRIM_PITCH", 5.0)],
                Some(VtolView::Trimmed("Q_TRIM_PITCH")),
                Some(VtolView::Trimmed("Q_TRIM_PITCH")),
            ),
            (&[("Q_FRAME_CLASS", 10.0)], Some(VtolView::Tailsitter), Some(VtolView::Tailsitter)),
            (&[("Q_TAILSIT_ENABLE", 1.0)], Some(VtolView::Tailsitter), Some(VtolView::Tailsitter)),
            (&[("Q_ENABLE", 0.0), ("Q_TRIM_PITCH", 5.0)], None, None),
        ] {
            let mut parameters = ParameterHistory::default();
            for (name, value) in quadplane.iter().chain(changes) {
                parameters.replace_value(name, *value);
            }
            let views = [false, true].map(|is_telemetry| VtolView::of_log(&parameters, is_telemetry));
            assert_eq!(views, [in_dataflash, in_telemetry], "{changes:?}");
        }
        for missing in ["Q_TAILSIT_ENABLE", "Q_TRIM_PITCH"] {
            let mut parameters = ParameterHistory::default();
            for (name, value) in quadplane.iter().filter(|(name, _)| *name != missing) {
                parameters.set_value(0.0, name, *value);
            }
            assert_eq!(VtolView::of_log(&parameters, false), Some(VtolView::Unknown(missing)));
            parameters.set_value(1.0, missing, 0.0);
            parameters.set_value(2.0, "Q_TRIM_PITCH", 1.0);
            parameters.set_value(3.0, "Q_TRIM_PITCH", 0.0);
            assert_eq!(VtolView::of_log(&parameters, false), Some(VtolView::Trimmed("Q_TRIM_PITCH")), "{missing}");
        }
    }

    /// Attitudes once a second with modes by time: those in another view's transition, and in AUTO (10), are left out, unless
    /// that is most of the log.
    #[test]
    fn the_body_is_known_while_the_mode_shows_the_view() {
        let trims = ViewTrims { forward_rad: 0.1, hover_rad: 0.2 };
        let logged = (0..100).map(|i| (f64::from(i), [0.0, 0.3, f32::NAN])).collect();
        for (modes, forward_and_hover) in [
            (&[(0.0, 5.0)][..], Some([100, 0])),
            (&[(10.0, 5.0), (40.0, 2.0), (60.0, 19.0), (70.0, 18.0)], Some([60, 24])),
            (&[(0.0, 5.0), (60.0, 10.0)], Some([60, 0])),
            (&[(0.0, 5.0), (40.0, 10.0)], None),
            (&[], None),
        ] {
            let modes_by_time = modes.iter().map(|&(t_s, mode)| (t_s, [mode])).collect();
            let body = trims.body_attitude(&logged, &modes_by_time);
            let count = |pitch_rad: f32| {
                let rows = body.iter().flat_map(Series::rows);
                rows.filter(|row| (row.row_values[1] - pitch_rad).abs() < 1e-6 && row.row_values[2].is_nan()).count()
            };
            assert_eq!(body.as_ref().map(|_| [count(0.4), count(0.5)]), forward_and_hover, "{modes:?}");
        }
    }
}
