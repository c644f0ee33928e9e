//! Axes of the attitude that ArduPlane logs of a quadplane or tailsitter.
//!
//! `ATT` and `ATTITUDE` are those of a view in VTOL modes: turned by 90 deg on tailsitters, and by `Q_TRIM_PITCH`, while
//! the compass is fixed to the body. In forward flight `ATTITUDE` is less the trim of fixed-wing flight.

use std::fmt;

use super::parameters::ParameterHistory;

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
}
