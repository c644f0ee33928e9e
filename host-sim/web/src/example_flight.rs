//! The example aircraft, observed while it flies its calibration mission.

use autoswing::calibration::{Calibration, Orientation};
use log_analysis::log::csv::FieldUnit;
use log_analysis::log::log_writers::encode_dataflash;
use log_analysis::report::{self, ReportOrigin};
use log_analysis::score::wrap_180;
use serde::{Deserialize, Serialize};
use simulator::mission::{self, MissionStep, TurnPlan};
use simulator::mission_report::{mission_json, report_mission};
use simulator::recording::Recorder;
use simulator::rig::Rig;
use simulator::transcript;
use simulator::world::WorldConfig;

use crate::loaded_log::{LoadedLog, LogRequest, RequestFailure};

/// Request of the page.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct FlightRequest {
    /// Seed of weather and noise.
    pub seed: u64,
}

/// State of the flight after one of its steps.
#[derive(Clone, Debug, Serialize)]
pub struct FlightStep {
    /// Stage of the mission.
    pub stage: &'static str,
    /// Part of the stage that is done, 0 to 1.
    pub done: f64,
    /// True magnetic heading, degrees.
    pub heading_deg: f64,
    /// Bank, right wing down positive, degrees.
    pub roll_deg: f64,
    /// Horizontal field as measured, forward and right, microtesla.
    pub measured_ut: [f32; 2],
    /// Heading error without a calibration, degrees.
    pub before_deg: f64,
    /// Horizontal field corrected by the module's calibration; none before it has one.
    pub corrected_ut: Option<[f32; 2]>,
    /// Heading error with the module's calibration, degrees.
    pub after_deg: Option<f64>,
}

/// Result of the whole example flight.
#[derive(Clone, Debug, Serialize)]
pub struct FlownExample {
    /// The page that `host-sim fly --report` writes.
    pub page: String,
    /// The object that `host-sim fly --json` prints.
    pub json: String,
}

/// Flies the mission on the aircraft of the paper, and reports each step.
pub fn fly_example(request: FlightRequest, report_step: &mut dyn FnMut(&FlightStep)) -> FlownExample {
    let mut rig = Rig::new(WorldConfig::of_table1(request.seed));
    let mut calibration = None;
    let mission_result = mission::fly_mission_of_module(&mut rig, TurnPlan::default(), &mut |step| {
        report_step(&flight_step(step, calibration));
        let shown = transcript::parse_shown_calibration(step.printed);
        calibration = shown.map(|shown| shown.calibration).or(calibration);
    });
    let origin = ReportOrigin {
        command_line: format!("host-sim fly --seed {}", request.seed),
        settings: vec![["airframe".to_owned(), "table1".to_owned()], ["seed".to_owned(), request.seed.to_string()]],
    };
    FlownExample {
        page: report::render_page(&report_mission(&mission_result, &origin)),
        json: mission_json(&mission_result).to_string(),
    }
}

/// Seed of the example log.
const EXAMPLE_SEED: u64 = 1;

/// The log that `host-sim fly --record example.bin` writes: an uncorrected compass on the aircraft of the paper.
///
/// # Errors
///
/// The log cannot be read, which would be a fault of its writer.
pub fn record_example() -> Result<LoadedLog, RequestFailure> {
    let mut rig = Rig::new(WorldConfig::of_table1(EXAMPLE_SEED));
    let mut recorder = Recorder::new(&rig);
    let mut record = |step: &MissionStep<'_>| recorder.record_until(step.now_us, step.world);
    mission::fly_mission_of_module(&mut rig, TurnPlan::default(), &mut record);
    let bytes = encode_dataflash(&recorder.recording);
    let request = LogRequest { names: vec!["example.bin".to_owned()], log: None, unit: FieldUnit::Milligauss };
    LoadedLog::read_log(&mut bytes.as_slice(), request)
}

/// State after a step, with the calibration that the module has by then.
fn flight_step(step: &MissionStep<'_>, calibration: Option<Calibration>) -> FlightStep {
    let state = step.world.true_state(step.now_us);
    let field = step.world.sensor_field(state.time_us);
    let level_field = |applied: &Calibration| state.attitude().to_level_frame(applied.calibrated_field(field));
    let error_deg = |applied: &Calibration| {
        wrap_180(f64::from(level_field(applied).heading_rad().to_degrees()) - state.heading_deg())
    };
    let horizontal_ut = |applied: &Calibration| [level_field(applied).ut.x, level_field(applied).ut.y];
    let uncalibrated = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
    FlightStep {
        stage: step.stage,
        done: step.done,
        heading_deg: state.heading_deg(),
        roll_deg: f64::from(state.attitude().roll_rad.to_degrees()),
        measured_ut: horizontal_ut(&uncalibrated),
        before_deg: error_deg(&uncalibrated),
        corrected_ut: calibration.as_ref().map(horizontal_ut),
        after_deg: calibration.as_ref().map(error_deg),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An example without parameters to load would show little of a verdict.
    #[test]
    fn the_example_log_has_a_bad_compass_with_parameters() {
        let choices = serde_json::from_str(
            r#"{ "module": null, "compass": null, "from_s": null, "to_s": null, "reference": null }"#,
        );
        let judged = record_example().unwrap().judge_log(&choices.unwrap()).unwrap();
        let json: serde_json::Value = serde_json::from_str(&judged.json).unwrap();
        let verdict = &json["compasses"][0]["verdict"];
        assert_eq!((&verdict["state"], &verdict["action"]), (&"bad".into(), &"load".into()));
    }

    #[test]
    fn steps_show_the_error_before_and_after_the_calibration() {
        let mut steps = Vec::new();
        let flown_example = fly_example(FlightRequest { seed: 1 }, &mut |step| steps.push(step.clone()));
        let largest = |errors: &[f64]| errors.iter().fold(0.0, |largest: f64, error| largest.max(error.abs()));
        let before: Vec<f64> = steps.iter().map(|step| step.before_deg).collect();
        let after: Vec<f64> = steps.iter().filter_map(|step| step.after_deg).collect();
        assert!(after.len() > 60 && before.len() > after.len() + 60, "{} of {}", after.len(), before.len());
        // Liu 2007, table 1: more than 20 deg before the calibration, less than 1 deg after it.
        assert!(largest(&before) > 20.0 && largest(&after) < 1.0, "{} to {}", largest(&before), largest(&after));
        let json: serde_json::Value = serde_json::from_str(&flown_example.json).unwrap();
        assert_eq!(json["accepted"], true);
        assert!(flown_example.page.contains("<dd>host-sim fly --seed 1</dd>"));
    }
}
