//! What the pilot does next, from the verdict on the compass in use.

use super::parameter_export::ParameterFormat;
use super::reading_checks::{CheckedMeaning, forbidding_check};
use super::verdict::{CompassAction, Verdict};
use crate::log::LogFormat;

/// Interval of attitudes above which telemetry is too slow where the autopilot's own log is faster, seconds.
const SLOW_TELEMETRY_S: f64 = 0.2;

/// Last step of loading parameters, for every autopilot.
const CHECK_ON_THE_GROUND: &str = "Before flying, away from cars and concrete, turn the aircraft to north, east, south and \
    west: its heading must follow, to a few degrees. The old values are at the end of the file.";

impl Verdict<'_> {
    /// What to do next, in steps; none if the compass in use is left as it is.
    #[must_use]
    pub fn next_steps(&self) -> Vec<String> {
        let actions: Vec<CompassAction> =
            self.compasses.iter().map(|compass| compass.judgement.recommended_action).collect();
        let of_compass_in_use =
            self.compasses_in_use_first().first().map(|compass| compass.judgement.recommended_action);
        let steps = match of_compass_in_use {
            _ if actions.contains(&CompassAction::LoadParameters) => loading_steps(self.parameter_format),
            Some(CompassAction::FlyAgain) => self.steps_before_another_flight(),
            Some(CompassAction::Replace) => vec![
                "Move the compass away from motors, battery leads, steel and magnets, or replace it; then calibrate it and \
                 judge the log of the next flight."
                    .to_owned(),
            ],
            Some(CompassAction::CorrectReading) => {
                vec![self.remedy_of_reading().to_owned()]
            }
            _ => return Vec::new(),
        };
        self.faster_log().into_iter().chain(steps).collect()
    }

    /// Another log where the parameters of the compass in use are unknown.
    fn remedy_of_reading(&self) -> &'static str {
        let compass = self.compasses_in_use_first().first().copied();
        let forbidding = compass.and_then(|compass| forbidding_check(&compass.reading_checks));
        match compass.map(|compass| self.flight.slot(compass.evaluation.compass_number)) {
            Some(Err(reason)) if forbidding.is_some_and(|check| check.meaning == CheckedMeaning::Slot) => {
                reason.remedy()
            }
            _ => "Correct what the verdict names, in the log's setup or in the table, and judge the log again.",
        }
    }

    /// The autopilot's own log in place of slow telemetry.
    fn faster_log(&self) -> Option<String> {
        let interval_s = self.evaluation.attitude_interval_s;
        (self.flight.log_format == LogFormat::TLog && interval_s > SLOW_TELEMETRY_S).then(|| {
            format!(
                "This telemetry has {:.1} attitudes a second: judge the autopilot's own log of this flight first, from its SD \
                 card.",
                1.0 / interval_s
            )
        })
    }

    fn steps_before_another_flight(&self) -> Vec<String> {
        let flight = self.flight;
        let manoeuvre = if flight.banks_into_turns() {
            "two full circles to each side at 20 to 30 deg of bank"
        } else {
            "two full turns to each side, and tilts by 15 deg on all headings"
        };
        [
            Some(format!("Fly {manoeuvre}, away from the ground.")),
            flight.gps.is_empty().then(|| "Wait for a GPS fix before arming: the log has no place.".to_owned()),
            flight.battery_current.is_empty().then(|| "Set up the battery monitor: the log has no current.".to_owned()),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// How ground stations load the file and what to check.
fn loading_steps(format: ParameterFormat) -> Vec<String> {
    let steps: &[&str] = match format {
        ParameterFormat::ArduPilot => &[
            "Load the file. Mission Planner: Config, Full Parameter List, Load from file, then Write Params. MAVProxy: param \
             load compass.param. QGroundControl: Vehicle Setup or Configuration, Parameters, Tools, Load from file (for review), with \
             compass.params.",
            "Restart the autopilot.",
        ],
        ParameterFormat::Px4 => &[
            "Load the file with QGroundControl: Vehicle Setup or Configuration, Parameters, Tools, Load from file (for \
             review). Or type param set NAME VALUE \
             for each line into PX4's shell, then param save.",
            "Restart the autopilot.",
        ],
        ParameterFormat::Inav => &["Paste the lines into the CLI tab of INAV Configurator."],
    };
    steps.iter().chain([&CHECK_ON_THE_GROUND]).map(|step| (*step).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::UnknownSlot;
    use crate::replay::tests::FLOWN_TURNS;

    #[test]
    fn the_steps_follow_from_the_action() {
        let (mut flight, mut evaluation) = FLOWN_TURNS.clone();
        let steps =
            |flight: &_, evaluation: &_| Verdict::new(flight, evaluation, ParameterFormat::ArduPilot).next_steps();
        let loading = steps(&flight, &evaluation);
        assert!(loading[0].contains("param load compass.param") && loading.len() == 3, "{loading:?}");
        // Rows of a few seconds determine no parameters.
        evaluation.compasses[0].rows.truncate(50);
        (evaluation.compasses[0].row_counts.used, evaluation.compasses[0].parameter_fit.fit) = (50, None);
        (flight.log_format, evaluation.attitude_interval_s) = (LogFormat::TLog, 0.345);
        let flying = steps(&flight, &evaluation);
        assert!(flying[0].contains("2.9 attitudes a second") && flying[1].contains("two full circles"), "{flying:?}");
        assert!(flying.iter().any(|step| step.contains("GPS fix")), "{flying:?}");
    }

    /// Another flight in the same kind of log has no parameters either.
    #[test]
    fn without_parameters_another_log_is_asked_for() {
        let (mut flight, evaluation) = FLOWN_TURNS.clone();
        for (reason, remedy) in [(UnknownSlot::NotInTables, "Judge the .ulg"), (UnknownSlot::NoParameters, "SD card")] {
            flight.compasses[0].slot = Err(reason);
            let steps = Verdict::new(&flight, &evaluation, ParameterFormat::Px4).next_steps();
            assert!(steps[0].contains(remedy) && steps.len() == 1, "{steps:?}");
        }
    }
}
