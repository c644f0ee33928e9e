//! Calibration mission: take-off uncalibrated, routine, calibration, restart, flight with a calibrated heading.
//!
//! The simulated pilot uses only console and heading sentences; only the evaluation uses the true state.

use autoswing::attitude::AttitudeSource;
use autoswing::calibration::{Calibration, Orientation};
use autoswing::frames::{Field, Sensor};
use serde::Serialize;

use crate::heading_errors::HeadingErrors;
use crate::module::{Module, ModuleRunEnd};
use crate::nmea::SentenceReader;
use crate::rig::Rig;
use crate::routine::CalibrationRoutine;
pub use crate::routine::TurnPlan;
use log_analysis::score::{ErrorStatistics, within_percent, wrap_180};

use crate::transcript::{self, Refusal, ShownCalibration};
use crate::world::aircraft::VehicleKind;
use crate::world::autopilot::Leg;
use crate::world::{TrueState, World, WorldConfig};

/// Stage before the routine: boot and take-off.
const TAKE_OFF: &str = "take-off, uncalibrated";

/// A step of a mission: the time has advanced.
#[derive(Clone, Copy)]
pub struct MissionStep<'a> {
    /// Name of the mission's stage, or of the part of the routine.
    pub stage: &'static str,
    /// Part of the stage that is done, 0 to 1.
    pub done: f64,
    /// The world at present.
    pub world: &'a World,
    /// Time since the start of the simulation, microseconds.
    pub now_us: u64,
    /// What the console has printed in answer to a command.
    pub printed: &'a str,
}

/// Measurement during the routine, for the report's plots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoutineMeasurement {
    /// Field in chip axes.
    pub field: Field<Sensor>,
    /// Motor current reported by the autopilot, amperes.
    pub current_a: Option<f32>,
    /// True state at the measurement.
    pub true_state: TrueState,
}

/// Heading output after the restart, evaluated at the arrival of its sentence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluatedHeading {
    /// True state when the sentence arrived.
    pub true_state: TrueState,
    /// Output heading less true heading, degrees.
    pub error_deg: f64,
    /// Output standard deviation, degrees.
    pub sigma_deg: f64,
}

/// Statistics of headings output after the restart. Errors include calibration, attitude, noise and latency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OutputStatistics {
    /// RMS heading error, degrees.
    pub rms_deg: f64,
    /// Largest heading error, degrees.
    pub max_deg: f64,
    /// Percent of the errors within one and two output standard deviations.
    pub within_percent: [f64; 2],
    /// Number of sentences with a heading.
    pub headings: usize,
    /// Number of sentences without a heading, including the start-up.
    pub empty: usize,
}

/// Results of a mission.
#[derive(Clone, Debug)]
pub struct MissionResult {
    /// Settings of the world in which the mission was flown.
    pub world: WorldConfig,
    /// Stored calibration, or the reason of its rejection, as printed on the console.
    pub calibration_result: Result<ShownCalibration, Refusal>,
    /// Heading errors of an uncalibrated module.
    pub errors_before: HeadingErrors,
    /// Errors with the stored calibration, or of the uncalibrated module without one.
    pub errors_after: HeadingErrors,
    /// Statistics of the output after the restart; `None` after a rejection.
    pub streamed_statistics: Option<OutputStatistics>,
    /// Measurements during the routine.
    pub routine_measurements: Vec<RoutineMeasurement>,
    /// Headings output after the restart.
    pub evaluated_headings: Vec<EvaluatedHeading>,
    /// Time of the end of the solve, seconds since the start.
    pub solve_end_s: f64,
    /// Transcript of the console session.
    pub transcript: String,
    /// Duration, seconds of simulation time.
    pub duration_s: f64,
}

/// Flies a mission with the simulated module; `on_step` receives each step.
pub fn fly_mission(world: WorldConfig, plan: TurnPlan, on_step: &mut dyn FnMut(&MissionStep<'_>)) -> MissionResult {
    fly_mission_of_module(&mut Rig::new(world), plan, on_step)
}

/// Flies a mission with a module that was just switched on; `on_step` receives each step.
pub fn fly_mission_of_module(
    module: &mut impl Module,
    plan: TurnPlan,
    on_step: &mut dyn FnMut(&MissionStep<'_>),
) -> MissionResult {
    let world = module.world().world_config();
    let mut mission = Mission {
        module,
        progress: (TAKE_OFF, 0.0),
        transcript: String::new(),
        routine_measurements: Vec::new(),
        on_step,
    };
    let before =
        HeadingErrors::evaluate_calibration(&Calibration::uncalibrated(Orientation::IDENTITY_ROTATION), &world);
    let routine = CalibrationRoutine::for_vehicle(world.aircraft.kind, plan, world.aircraft.heading_deg);
    let calibration_result = mission.calibrate(&routine);
    let solve_end_s = mission.module.now_us() as f64 / 1e6;
    let (streamed, headings) = calibration_result.as_ref().map_or((None, Vec::new()), |_| {
        let (streamed, headings) = mission.evaluate_output(&routine.mission_legs);
        (Some(streamed), headings)
    });
    let after = calibration_result.as_ref().map_or_else(
        |_| before.clone(),
        |shown_calibration| HeadingErrors::evaluate_calibration(&shown_calibration.calibration, &world),
    );
    MissionResult {
        world,
        calibration_result,
        errors_before: before,
        errors_after: after,
        streamed_statistics: streamed,
        routine_measurements: mission.routine_measurements,
        evaluated_headings: headings,
        solve_end_s,
        transcript: mission.transcript,
        duration_s: mission.module.now_us() as f64 / 1e6,
    }
}

struct Mission<'a, M> {
    module: &'a mut M,
    /// Stage, and the part of it that is done.
    progress: (&'static str, f64),
    transcript: String,
    routine_measurements: Vec<RoutineMeasurement>,
    on_step: &'a mut dyn FnMut(&MissionStep<'_>),
}

const RUN_STEP_S: f64 = 0.5;

/// Longest time from a restart to the first line on the console, seconds.
const MAX_RESTART_S: f64 = 0.5;

/// Timeout of the solve, seconds; solving, verifying and storing take about 1 s.
const SOLVE_TIMEOUT_S: f64 = 10.0;

impl<M: Module> Mission<'_, M> {
    fn calibrate(&mut self, routine: &CalibrationRoutine) -> Result<ShownCalibration, Refusal> {
        let source = self.module.world().world_config().attitude;
        if source != AttitudeSource::Autopilot {
            self.rest_with_attitude_of(source);
        }
        self.module.world().set_armed(true);
        self.fly_leg(TAKE_OFF, routine.take_off);
        self.send_console_line("status");
        self.send_console_line(routine.start_command);
        for part in &routine.routine_parts {
            for &leg in &part.legs {
                self.fly_leg(part.part_name, leg);
            }
            self.send_console_line("status");
        }
        self.await_solve_notice()?;
        transcript::parse_shown_calibration(&self.send_console_line("cal show"))
            .ok_or_else(|| Refusal::new("unreadable", "cal show could not be read"))
    }

    /// Sets the source, and rests from the power-on, as the module's own sensors need. A boat in waves does not rest.
    fn rest_with_attitude_of(&mut self, source: AttitudeSource) {
        let can_rest = self.module.world().world_config().aircraft.kind != VehicleKind::Boat;
        if can_rest {
            self.module.world().hold_still();
        }
        self.advance_by(MAX_RESTART_S);
        let (name, _) = AttitudeSource::NAMED_SOURCES[source as usize];
        self.send_console_line(&format!("set attitude {name}"));
        if can_rest {
            self.module.rest();
        }
    }

    /// Result of the solve. If the module does not solve automatically, the pilot requests it.
    fn await_solve_notice(&mut self) -> Result<(), Refusal> {
        let timeout_steps = (SOLVE_TIMEOUT_S / RUN_STEP_S) as usize;
        for step in 0..2 * timeout_steps {
            if let Some(notice) = transcript::parse_solve_notice(&self.transcript) {
                return notice;
            }
            if step == timeout_steps
                && let Some(error) = transcript::parse_error(&self.send_console_line("cal solve"))
            {
                return Err(error);
            }
            self.progress = ("solve, verify, store", step as f64 / (2 * timeout_steps) as f64);
            self.advance_one_step();
            self.append_console_output();
        }
        Err(Refusal::new("silent", "the module did not report the end of its solve"))
    }

    /// Restarts the module, flies the mission's legs and compares the output with true headings.
    fn evaluate_output(&mut self, legs: &[Leg]) -> (OutputStatistics, Vec<EvaluatedHeading>) {
        let _ = self.module.instrument_cable().receive_bytes();
        // Reset by the pin, because a module in flight refuses the restart command.
        self.module.reset_module();
        self.advance_by(MAX_RESTART_S);
        self.append_console_output();
        let mut evaluated_headings: Vec<EvaluatedHeading> = Vec::new();
        let mut empty = 0;
        let mut reader = SentenceReader::default();
        for (done, &leg) in legs.iter().enumerate() {
            self.module.world().append_leg(leg);
            self.progress = ("restart, fly on", done as f64 / legs.len() as f64);
            while self.module.world().unfinished_leg_count() > 0 && self.advance_one_step() {
                for timed_byte in self.module.instrument_cable().receive_timed() {
                    let Some(received) =
                        reader.push_byte(timed_byte.byte).filter(|sentence| sentence.sentence_kind == "PASWH")
                    else {
                        continue;
                    };
                    match (received.heading_deg, received.sigma_deg) {
                        (Some(deg), Some(sigma_deg)) => {
                            let true_state = self.module.world().true_state(timed_byte.arrives_at_us);
                            let error_deg = wrap_180(deg - true_state.heading_deg());
                            evaluated_headings.push(EvaluatedHeading { true_state, error_deg, sigma_deg });
                        }
                        _ => empty += 1,
                    }
                }
            }
        }
        self.append_console_output();
        let errors_deg: Vec<f64> = evaluated_headings.iter().map(|heading| heading.error_deg).collect();
        let normalised: Vec<f64> =
            evaluated_headings.iter().map(|heading| heading.error_deg / heading.sigma_deg).collect();
        let ErrorStatistics { rms_deg, max_deg, .. } = ErrorStatistics::from_errors_deg(&errors_deg);
        let (within_percent, headings) = (within_percent(&normalised), evaluated_headings.len());
        (OutputStatistics { rms_deg, max_deg, within_percent, headings, empty }, evaluated_headings)
    }

    /// Flies a leg; records measurements during the routine.
    fn fly_leg(&mut self, stage: &'static str, leg: Leg) {
        let start_state = self.module.world().true_state(self.module.now_us());
        self.module.world().append_leg(leg);
        while self.module.world().unfinished_leg_count() > 0 && self.advance_one_step() {
            self.append_console_output();
            let now = self.module.world().true_state(self.module.now_us());
            if stage != TAKE_OFF {
                let field = self.module.world().sensor_field(now.time_us);
                let current_a = self.module.world().reported_current_a(now.time_us).map(|amperes| amperes as f32);
                self.routine_measurements.push(RoutineMeasurement { field, current_a, true_state: now });
            }
            let done = match leg {
                Leg::Straight { seconds, .. } | Leg::Hover { seconds } | Leg::Tilt { seconds, .. } => {
                    (now.time_us - start_state.time_us) as f64 / 1e6 / seconds
                }
                Leg::Turn { heading_change_deg, .. } | Leg::Yaw { heading_change_deg, .. } => {
                    (now.heading_rad - start_state.heading_rad).to_degrees() / heading_change_deg
                }
            };
            self.progress = (stage, done.clamp(0.0, 1.0));
        }
    }

    /// Advances by one step; false if the module has failed.
    fn advance_one_step(&mut self) -> bool {
        self.advance_by(RUN_STEP_S)
    }

    fn advance_by(&mut self, seconds: f64) -> bool {
        let end = self.module.run_for_s(seconds);
        self.report_step("");
        end == ModuleRunEnd::Time
    }

    fn send_console_line(&mut self, line: &str) -> String {
        let printed = self.module.send_console_line(line);
        self.report_step(&printed);
        self.transcript.push_str(&printed);
        printed
    }

    fn report_step(&mut self, printed: &str) {
        let (stage, done) = self.progress;
        let (world, now_us) = (self.module.world(), self.module.now_us());
        (self.on_step)(&MissionStep { stage, done, world, now_us, printed });
    }

    fn append_console_output(&mut self) {
        self.transcript.push_str(&self.module.take_console_output());
    }
}
