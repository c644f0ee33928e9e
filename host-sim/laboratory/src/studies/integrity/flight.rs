//! One flight of a case: calibration, then a flight in which every output sentence is evaluated.

use autoswing::attitude::AttitudeSource;
use autoswing_firmware::health::ResetCause;
use autoswing_module::settings::HeadingKind;
use log_analysis::score::wrap_180;
use nalgebra::Vector3;
use simulator::heading_errors::HeadingErrors;
use simulator::module::{Module, ModuleRunEnd};
use simulator::nmea::{HeadingSentence, SentenceReader};
use simulator::random::{RandomStream, StreamPurpose};
use simulator::rig::Rig;
use simulator::transcript;
use simulator::world::autopilot::Leg;
use simulator::world::cable_far_end::FarEnd;
use simulator::world::{TrueState, WorldConfig};

use super::fault_case::{FaultCase, FaultOnset, RandomCase};
use super::integrity_plan::IntegrityPlan;
use super::statistics::{EvaluatedSentence, HeadingStatistics};

/// Accepted calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcceptedCalibration {
    /// Heading error estimated by the module, degrees RMS.
    pub expected_error_deg: f64,
    /// True heading error without noise, with the hard iron at the end of the calibration, at the attitude that the
    /// source reports on average, degrees RMS.
    pub true_error_deg: f64,
    /// Time from start to acceptance, seconds.
    pub duration_s: f64,
}

impl AcceptedCalibration {
    /// True over estimated heading error.
    #[must_use]
    pub fn error_ratio(&self) -> f64 {
        self.true_error_deg / self.expected_error_deg
    }
}

/// Error of the module's estimate of a hard-iron change, relative to the change, after a full turn each way; 1 without
/// an estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronEstimateError(pub f64);

/// Results of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseFlightResult {
    /// Calibration, or the code of its rejection.
    pub calibration: Result<AcceptedCalibration, String>,
    /// Heading error in sigmas [at these instants](NORMALISED_ERROR_INSTANTS_S) after the calibration; `None` without a
    /// heading.
    pub normalised_errors: [Option<f64>; NORMALISED_ERROR_INSTANTS_S.len()],
    /// Statistics of the headings output after the calibration.
    pub output_statistics: HeadingStatistics,
    /// Codes of the console's notes after the calibration.
    pub note_codes: Vec<String>,
    /// Error of the estimate of a hard-iron change after the calibration.
    pub hard_iron_error: Option<HardIronEstimateError>,
}

/// Instants of the normalised errors, seconds after the calibration.
pub const NORMALISED_ERROR_INSTANTS_S: [f64; 3] = [10.0, 60.0, 170.0];

const RUN_STEP_S: f64 = 0.5;

const SENTENCE_INTERVAL_S: f64 = 0.1;

/// Time until an accepted calibration is stored, seconds.
const STORING_S: f64 = 2.0;

/// Time after the turns within which the module must report the result of its solve, seconds.
const SOLVE_TIMEOUT_S: f64 = 10.0;

/// Flies the case for a seed, with vehicle, attitude source and heading output of the plan.
#[must_use]
pub fn fly_case(case: &FaultCase, seed: u64, plan: &IntegrityPlan) -> CaseFlightResult {
    fly_drawn_case(case, case.draw_case(seed, plan.aircraft, plan.attitude_protocol), seed, plan)
}

/// Flies a drawn case of a seed.
pub(super) fn fly_drawn_case(
    case: &FaultCase,
    mut drawn_case: RandomCase,
    seed: u64,
    plan: &IntegrityPlan,
) -> CaseFlightResult {
    if drawn_case.world.attitude == AttitudeSource::Autopilot {
        drawn_case.world.attitude = plan.attitude;
    }
    let faults = std::mem::take(&mut drawn_case.faults);
    let field_faults = faults.field_faults.clone();
    let mut rig = Rig::with_port_devices(drawn_case.world, faults, [drawn_case.far_end, FarEnd::Unconnected]);
    let RandomCase { world, ref fault_switch, fault_onset: onset, mean_attitude_error_rad, .. } = drawn_case;
    rig.world.set_armed(true);
    if onset == FaultOnset::Always {
        fault_switch.set_active(0, u64::MAX);
    }
    rig.run_for_s(2.0);
    // Rest shows the offset of the module's own gyro.
    if world.attitude != AttitudeSource::Autopilot {
        let (attitude_name, _) = AttitudeSource::NAMED_SOURCES[world.attitude as usize];
        rig.send_console_line(&format!("set attitude {attitude_name}"));
        rig.rest();
    }
    select_heading(&mut rig, plan);
    rig.send_console_line(drawn_case.routine.start_command);
    if let FaultOnset::DuringCalibration { after_s, until_s } = onset {
        fault_switch.set_active(add_seconds_us(rig.now_us(), after_s), add_seconds_us(rig.now_us(), until_s));
    }
    let began_us = rig.now_us();
    let calibration = calibrate(&mut rig, &drawn_case.routine.legs());
    let calibrated = calibration.map(|(shown_calibration, at_us)| AcceptedCalibration {
        expected_error_deg: shown_calibration.expected_rms_deg,
        true_error_deg: HeadingErrors::evaluate_with_faults(
            &shown_calibration.calibration,
            &world,
            &|state| {
                field_faults.iter().map(|fault| fault.steady_field_ut(&TrueState { time_us: at_us, ..*state })).sum()
            },
            mean_attitude_error_rad,
        )
        .statistics()
        .rms_deg,
        duration_s: (at_us - began_us) as f64 / 1e6,
    });
    let mut normalised_errors = [None; NORMALISED_ERROR_INSTANTS_S.len()];
    let mut output_statistics = HeadingStatistics::default();
    let mut notes = Vec::new();
    if calibrated.is_ok() {
        if drawn_case.is_restarted {
            rig.run_for_s(STORING_S);
            rig.power_on(ResetCause::PowerOn);
            rig.run_for_s(RUN_STEP_S);
            select_heading(&mut rig, plan);
        }
        if let FaultOnset::AfterCalibration { after_s, for_s } = onset {
            let from_us = add_seconds_us(rig.now_us(), after_s);
            fault_switch.set_active(from_us, add_seconds_us(from_us, for_s));
        }
        let evaluated_from_us = if let FaultOnset::AfterCalibration { after_s, .. } = onset {
            add_seconds_us(rig.now_us(), after_s)
        } else {
            0
        };
        let mut pending_instants_us =
            NORMALISED_ERROR_INSTANTS_S.map(|after_s| add_seconds_us(rig.now_us(), after_s)).into_iter().enumerate();
        let mut pending = pending_instants_us.next();
        notes = fly_after_calibration(&mut rig, &drawn_case, seed, &mut |at_us, evaluated_sentence| {
            if let Some((i, _)) = pending.filter(|&(_, instant_us)| at_us >= instant_us) {
                normalised_errors[i] = match evaluated_sentence {
                    EvaluatedSentence::Heading { error_deg, sigma_deg, .. } => Some(error_deg / sigma_deg),
                    EvaluatedSentence::Empty(_) => None,
                };
                pending = pending_instants_us.next();
            }
            // A hard-iron change during calibration remains part of the airframe after the calibration.
            let is_fault_active = match onset {
                FaultOnset::Never => false,
                FaultOnset::Always | FaultOnset::DuringCalibration { .. } => true,
                FaultOnset::AfterCalibration { .. } => fault_switch.is_on(at_us),
            };
            output_statistics.add_sentence(
                at_us,
                SENTENCE_INTERVAL_S,
                evaluated_sentence,
                at_us >= evaluated_from_us,
                is_fault_active,
            );
        });
    }
    let hard_iron_error = (calibrated.is_ok() && case.changes_hard_iron).then(|| {
        let now = rig.world.true_state(rig.now_us());
        let added_field_ut = field_faults.iter().map(|fault| fault.added_field_ut(&now)).sum();
        hard_iron_estimate_error(&mut rig, &world, added_field_ut)
    });
    CaseFlightResult {
        calibration: calibrated,
        normalised_errors,
        output_statistics,
        note_codes: notes,
        hard_iron_error,
    }
}

fn select_heading(rig: &mut Rig, plan: &IntegrityPlan) {
    rig.send_console_line(&format!("set heading {}", plan.heading.choice_name()));
}

/// Flies a full turn each way and compares the module's estimate with a hard-iron change of `added_field_ut`, chip
/// axes.
fn hard_iron_estimate_error(rig: &mut Rig, world: &WorldConfig, added_field_ut: Vector3<f64>) -> HardIronEstimateError {
    for heading_change_deg in [360.0, -360.0] {
        rig.world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    while rig.world.unfinished_leg_count() > 0 && rig.run_for_s(RUN_STEP_S) == ModuleRunEnd::Time {}
    let estimated_ut = transcript::hard_iron_change_ut(&rig.send_console_line("status all"))
        .map_or_else(Vector3::zeros, Vector3::from);
    // By `m = A h + b`, the change in the measurement m equals a change of the field h by `A^-1 added_field_ut`. A
    // singular airframe measures nothing.
    let true_ut =
        world.airframe.field_matrix.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * added_field_ut);
    HardIronEstimateError((estimated_ut - true_ut).norm() / true_ut.norm())
}

fn add_seconds_us(from_us: u64, by_s: f64) -> u64 {
    // The cast saturates, so infinity remains beyond all times.
    from_us.saturating_add((by_s * 1e6) as u64)
}

/// Flies the routine until the module reports the result of its solve; returns it with its time.
fn calibrate(rig: &mut Rig, legs: &[Leg]) -> Result<(transcript::ShownCalibration, u64), String> {
    for &leg in legs {
        rig.world.append_leg(leg);
    }
    let mut session = String::new();
    let mut waited_s = 0.0;
    let mut is_solve_requested = false;
    let notice = loop {
        if let Some(notice) = transcript::parse_solve_notice(&session) {
            break notice;
        }
        if rig.run_for_s(RUN_STEP_S) != ModuleRunEnd::Time {
            return Err("no-power".to_owned());
        }
        session.push_str(&rig.take_console_output());
        if rig.world.unfinished_leg_count() > 0 {
            continue;
        }
        waited_s += RUN_STEP_S;
        if waited_s > SOLVE_TIMEOUT_S && !is_solve_requested {
            // If the module does not solve automatically, the pilot requests it.
            is_solve_requested = true;
            waited_s = 0.0;
            let printed = rig.send_console_line("cal solve");
            if let Some(error) = transcript::parse_error(&printed) {
                break Err(error);
            }
            session.push_str(&printed);
        } else if waited_s > SOLVE_TIMEOUT_S {
            return Err("silent".to_owned());
        }
    };
    let at_us = rig.now_us();
    notice.map_err(|refusal| refusal.code)?;
    // Flies the remaining legs of the routine.
    while rig.world.unfinished_leg_count() > 0 && rig.run_for_s(RUN_STEP_S) == ModuleRunEnd::Time {}
    let shown_calibration = transcript::parse_shown_calibration(&rig.send_console_line("cal show"));
    Ok((shown_calibration.ok_or_else(|| "not-shown".to_owned())?, at_us))
}

/// Flight after the calibration: optional time on the ground, then legs; evaluates every output sentence. Returns the
/// codes of the console's notes.
fn fly_after_calibration(
    rig: &mut Rig,
    drawn_case: &RandomCase,
    seed: u64,
    on_sentence: &mut dyn FnMut(u64, &EvaluatedSentence),
) -> Vec<String> {
    let RandomCase { ground_time_s, flight_after_calibration_s, first_legs, further_legs, .. } = *drawn_case;
    let mut random = RandomStream::new(seed, StreamPurpose::Legs);
    if ground_time_s > 0.0 {
        rig.world.hold_still();
    }
    let take_off_us = add_seconds_us(rig.now_us(), ground_time_s);
    let end_us = add_seconds_us(take_off_us, flight_after_calibration_s);
    let vehicle_kind = rig.world.world_config().aircraft.kind;
    for leg in first_legs(vehicle_kind, &mut random) {
        rig.world.append_leg(leg);
    }
    let mut reader = SentenceReader::default();
    let _ = (rig.instrument.receive_bytes(), rig.take_console_output());
    let mut notes = Vec::new();
    while rig.now_us() < end_us {
        if ground_time_s > 0.0 && rig.now_us() >= take_off_us {
            rig.world.end_prescribed_motion();
        }
        if rig.world.unfinished_leg_count() < 2 {
            for leg in further_legs(vehicle_kind, &mut random) {
                rig.world.append_leg(leg);
            }
        }
        if rig.run_for_s(RUN_STEP_S) != ModuleRunEnd::Time {
            break;
        }
        let printed = rig.take_console_output();
        // The console erases the line before a note.
        notes.extend(printed.split("note ").skip(1).filter_map(|text| Some(text.split_once(": ")?.0.to_owned())));
        for timed_byte in rig.instrument.receive_timed() {
            if let Some(received) =
                reader.push_byte(timed_byte.byte).filter(|sentence| sentence.sentence_kind == "PASWH")
            {
                let true_heading_deg = rig.world.true_state(timed_byte.arrives_at_us).heading_deg();
                on_sentence(timed_byte.arrives_at_us, &evaluated_sentence(received, true_heading_deg));
            }
        }
    }
    notes
}

fn evaluated_sentence(received: HeadingSentence, true_heading_deg: f64) -> EvaluatedSentence {
    match (received.heading_deg, received.sigma_deg) {
        (Some(sent_deg), Some(sigma_deg)) => {
            let is_smooth = received.heading_kind.as_deref() == Some(HeadingKind::Smooth.choice_name());
            EvaluatedSentence::Heading { error_deg: wrap_180(sent_deg - true_heading_deg), sigma_deg, is_smooth }
        }
        _ => EvaluatedSentence::Empty(received.status.unwrap_or_default()),
    }
}
