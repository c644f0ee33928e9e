//! `status`: the state in six lines, or with settings and counters.

use core::fmt::{self, Display, Write};

use super::calibration::write_latency;
use super::settings::{CAN_LINE, PORT_LINES, setting_lines, write_field_model, write_setting_line};
use crate::health::{CanState, Diagnostics, EventCounts, ResetCause, StackUse};
use crate::wire::dronecan::outbound::BusCounts;
use autoswing::attitude::{AttitudeSource, HAS_OWN_ATTITUDE};
use autoswing::calibration::CollectionPart;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{PartCoverage, SECTOR_COUNT};
use autoswing::decimal::{Decimal, ShortestDecimal};
use autoswing::frames::RollPitch;
use autoswing::heading::NoHeading;
use autoswing::instrument::InstallationChange;
use autoswing_module::compass::{ModuleState, StatusReport, TrialResult};
use autoswing_module::messages::Message;
use autoswing_module::settings::{PortNumber, ProtocolKind};

/// Writes the reply to `status`: the state, sensors, and the collection, what went wrong last, or the
/// calibration.
pub(super) fn write_status(out: &mut impl Write, report: &StatusReport, health: &Diagnostics) -> fmt::Result {
    writeln!(out, "ok {}", report.module_state.state_name())?;
    write_instrument_state(out, health)?;
    write_sample_loss(out, report)?;
    match (report.module_state, &report.last_collection_outcome) {
        (ModuleState::Collecting, _) if report.collection_progress.procedure == Procedure::Flight => {
            write_expected_accuracy(out, report.last_trial.as_ref(), report.settings.accuracy_deg)
        }
        (ModuleState::Collecting, _) => write_progress_summary(out, report),
        (_, None | Some(Message::Solved(Ok(_)))) => write_stored_calibration(out, report, health),
        _ => write_last_outcome(out, report),
    }
}

/// Writes why readings of a collection do not become samples.
fn write_sample_loss(out: &mut impl Write, report: &StatusReport) -> fmt::Result {
    match report.sample_loss {
        Some(loss) if report.module_state == ModuleState::Collecting => {
            writeln!(out, "lost readings: {loss}; {}", loss.advice())
        }
        _ => Ok(()),
    }
}

/// Writes the progress of a collection.
fn write_progress_summary(out: &mut impl Write, report: &StatusReport) -> fmt::Result {
    let progress = &report.collection_progress;
    let [left, right, level, free] = CollectionPart::ALL_PARTS.map(|part| progress.coverage_of(part));
    let (left, right) = (left.percent, right.percent);
    write!(out, "collecting: {}", progress.procedure.procedure_name())?;
    match progress.procedure {
        // Straight flight covers no circle.
        Procedure::Turns => writeln!(out, ", left {left} %, right {right} %, {} level samples", level.fit_count),
        Procedure::Level => writeln!(out, ", {} %", level.percent),
        Procedure::Swing => writeln!(out, ", {} marks, level {} %", progress.mark_count, level.percent),
        Procedure::Flight | Procedure::Tumble => writeln!(out, ", {} samples", free.fit_count),
    }
}

fn write_last_outcome(out: &mut impl Write, report: &StatusReport) -> fmt::Result {
    match &report.last_collection_outcome {
        Some(Message::Solved(Ok(_))) => writeln!(out, "last solve: ok"),
        Some(message) => writeln!(out, "last solve: {}: {}", message.stable_code(), message.message_text()),
        None => writeln!(out, "last solve: none"),
    }
}

/// Writes the stored calibration, or why it is not applied.
fn write_stored_calibration(out: &mut impl Write, report: &StatusReport, health: &Diagnostics) -> fmt::Result {
    let Some(record) = &report.stored_calibration else { return writeln!(out, "calibration: none") };
    write!(out, "calibration: number {}, ", record.serial_number)?;
    if health.sensor.is_some_and(|sensor| sensor != record.sensor) {
        writeln!(out, "not applied: it is of another sensor, {}", record.sensor)
    } else if record.mount != report.settings.mount {
        writeln!(out, "not applied: it is of mount {}", record.mount.orientation_name())
    } else {
        writeln!(out, "{}", record.expected_accuracy())
    }
}

/// Writes the reply to `status all`.
pub(super) fn write_full_status(out: &mut impl Write, report: &StatusReport, health: &Diagnostics) -> fmt::Result {
    writeln!(out, "ok {}", report.module_state.state_name())?;
    write_instrument_state(out, health)?;
    writeln!(out, "armed: {}", report.is_armed.map_or("not known", |armed| if armed { "yes" } else { "no" }))?;
    write_motor_current(out, health.current_a)?;
    write_progress_details(out, report)?;
    write_sample_loss(out, report)?;
    if let (ModuleState::Collecting, Procedure::Flight) = (report.module_state, report.collection_progress.procedure) {
        write_expected_accuracy(out, report.last_trial.as_ref(), report.settings.accuracy_deg)?;
    }
    write_stored_calibration(out, report, health)?;
    if let Some(record) = &report.stored_calibration {
        write_latency(out, &record.calibration, record.quality.latency)?;
    }
    write_last_outcome(out, report)?;
    for line in setting_lines().filter(|line| *line != CAN_LINE) {
        write_setting_line(out, line, ": ", report)?;
        for port in PortNumber::ALL_PORTS.into_iter().filter(|port| *port.port_element(&PORT_LINES) == line) {
            let configured = report.settings.settings_of_port(port).protocol;
            write_detected_protocol(out, configured, health.port_protocol(port))?;
        }
        writeln!(out)?;
    }
    if let Some(can) = &health.can_state {
        write_setting_line(out, CAN_LINE, ": ", report)?;
        write_can_state(out, can)?;
    }
    write_field_model(out, &report.local_field)?;
    write_counters(out, &health.event_counts, report.settings.attitude_source)?;
    if let Some(StackUse { peak_used_bytes, size_bytes }) = health.stack_use {
        writeln!(out, "stack: {peak_used_bytes} of {size_bytes} bytes used at most")?;
    }
    write_uptime(out, health)
}

/// Writes the reply to `status` in safe mode.
pub(super) fn write_safe_mode_status(out: &mut impl Write, health: &Diagnostics) -> fmt::Result {
    writeln!(out, "ok {}: {}", Message::SafeMode.stable_code(), Message::SafeMode.message_text())?;
    write_uptime(out, health)
}

fn write_uptime(out: &mut impl Write, health: &Diagnostics) -> fmt::Result {
    writeln!(out, "up: {} s, started by {}", health.uptime_s, ResetText(&health.reset_cause))
}

fn write_motor_current(out: &mut impl Write, current_a: Option<f32>) -> fmt::Result {
    match current_a {
        Some(amperes) => writeln!(out, "current: {} A", Decimal::<1>(amperes)),
        None => writeln!(out, "current: not reported"),
    }
}

/// Adds to the line of a port that is set to `auto` which protocol was detected on it.
fn write_detected_protocol(out: &mut impl Write, configured: ProtocolKind, detected: ProtocolKind) -> fmt::Result {
    match (configured, detected) {
        (ProtocolKind::Auto, ProtocolKind::Auto) => out.write_str(", no protocol detected yet"),
        (ProtocolKind::Auto, detected) => write!(out, ", found {}", detected.choice_name()),
        _ => Ok(()),
    }
}

/// Writes the number of the node, and its traffic.
fn write_can_state(out: &mut impl Write, can: &CanState) -> fmt::Result {
    match can.node {
        Some(node) => write!(out, "; node {}", node.number())?,
        None => out.write_str("; no number yet")?,
    }
    if can.has_number_conflict {
        out.write_str(", which another node has, too")?;
    }
    let BusCounts { sent_frames: sent, received_frames: received, bus_errors: errors } = can.frame_counts;
    writeln!(out, "; {sent} frames sent, {received} received, {errors} errors")
}

fn write_progress_details(out: &mut impl Write, report: &StatusReport) -> fmt::Result {
    let progress = &report.collection_progress;
    let automatic_text = if report.is_automatic { ", automatic" } else { "" };
    let waiting_text = if report.awaits_arming { ", when the autopilot arms" } else { "" };
    writeln!(out, "collection: {}{automatic_text}{waiting_text}", progress.procedure.procedure_name())?;
    let [left, right, level, free] = CollectionPart::ALL_PARTS.map(|part| progress.coverage_of(part));
    match progress.procedure {
        Procedure::Turns => {
            writeln!(out, "left: {}", CoverageText(left))?;
            writeln!(out, "right: {}", CoverageText(right))?;
            writeln!(out, "level: {}", CoverageText(level))
        }
        Procedure::Level => writeln!(out, "level: {}", CoverageText(level)),
        Procedure::Swing => {
            writeln!(out, "marks: {}", progress.mark_count)?;
            writeln!(out, "level: {}", CoverageText(level))
        }
        Procedure::Flight | Procedure::Tumble => {
            writeln!(out, "attitudes: {} samples, {} held back", free.fit_count, free.held_back_count)
        }
    }
}

/// Writes the expected accuracy of a collection in flight, and the missing manoeuvre.
fn write_expected_accuracy(out: &mut impl Write, trial: Option<&TrialResult>, wanted_deg: f32) -> fmt::Result {
    out.write_str("collecting: ")?;
    let Some(TrialResult {
        expected_error_deg,
        missing_manoeuvre: manoeuvre,
        is_limited_by_attitude: is_at_floor,
        is_stalled,
        refusal,
    }) = trial
    else {
        return writeln!(out, "no expected error yet; go on");
    };
    if let Some(expected_error_deg) = *expected_error_deg {
        write!(out, "expected {} deg, wanted {}", Decimal::<1>(expected_error_deg), ShortestDecimal(wanted_deg, 1))?;
    }
    match (manoeuvre, refusal) {
        (Some(manoeuvre), _) => write!(out, "; missing: {manoeuvre}")?,
        (None, _) if *is_at_floor => out.write_str("; more of the same would not help, see set attitude-error")?,
        (None, _) if *is_stalled => out.write_str("; more of the same does not help")?,
        (None, None) => out.write_str("; go on")?,
        (None, Some(_)) => {}
    }
    match refusal {
        Some(refusal) if manoeuvre.is_none() || expected_error_deg.is_none() || !refusal.is_curable_by_samples() => {
            writeln!(
                out,
                "{}{}: {refusal}",
                if expected_error_deg.is_some() { "; " } else { "" },
                refusal.stable_code()
            )
        }
        _ => writeln!(out),
    }
}

fn write_instrument_state(out: &mut impl Write, health: &Diagnostics) -> fmt::Result {
    match health.sensor {
        Some(identity) => writeln!(out, "sensor: {identity}")?,
        None => writeln!(out, "sensor: not found")?,
    }
    match health.attitude {
        Some(RollPitch { roll_rad, pitch_rad }) => {
            let [roll, pitch] = [roll_rad, pitch_rad].map(|rad| Decimal::<1>(rad.to_degrees()));
            writeln!(out, "attitude: roll {roll} deg, pitch {pitch} deg")?;
        }
        None => writeln!(out, "attitude: none in use")?,
    }
    match health.heading {
        Ok(heading) => {
            let [heading_deg, sigma_deg] = [heading.magnetic_deg(), heading.sigma_deg()].map(Decimal::<1>);
            writeln!(out, "heading: {heading_deg} deg magnetic, sigma {sigma_deg} deg")
        }
        Err(reason) => writeln!(out, "heading: none, {}", reason.stable_code()),
    }?;
    match &health.installation_change {
        Some(change) => {
            let change_name = match change {
                InstallationChange::HardIron(_) => "hard iron: changed by",
                InstallationChange::Mount(_) => "mount: turned by",
            };
            writeln!(out, "{change_name} {}", Message::InstallationChanged(*change).message_text())
        }
        None if health.heading == Err(NoHeading::Uncalibrated) => {
            writeln!(out, "hard iron: changes are detected once there is a calibration")
        }
        None => writeln!(out, "hard iron: no change detected"),
    }
}

fn write_counters(out: &mut impl Write, counts: &EventCounts, attitude_source: AttitudeSource) -> fmt::Result {
    writeln!(
        out,
        "readings: {}, {} overruns, {} errors, {} register upsets repaired",
        counts.readings, counts.overruns, counts.sensor_errors, counts.sensor_register_upsets
    )?;
    if !HAS_OWN_ATTITUDE || counts.inertial_readings == 0 {
        writeln!(out, "gyro: not found")?;
    } else {
        write!(
            out,
            "gyro: {} readings, {} errors, {} register upsets repaired, {} rates unlike the autopilot's",
            counts.inertial_readings,
            counts.inertial_errors,
            counts.inertial_register_upsets,
            counts.inertial_rate_contradictions
        )?;
        match attitude_source {
            AttitudeSource::Autopilot => write!(out, ", not in use")?,
            AttitudeSource::Automatic if counts.inertial_estimates_after_rest == 0 => {
                write!(out, ", not in use before the first rest")?;
            }
            AttitudeSource::Automatic | AttitudeSource::Own => {}
        }
        if counts.corrected_latency_ms > 0 {
            write!(out, ", attitude's latency of {} ms corrected", counts.corrected_latency_ms)?;
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "rejected readings: {} saturated, {} clipped, {} stuck, {} spikes; attitude: {} frozen, {} spikes, {} rates; \
         {} currents",
        counts.saturated,
        counts.sensor_clipped,
        counts.sensor_stuck,
        counts.sensor_spikes,
        counts.attitude_frozen,
        counts.attitude_spikes,
        counts.attitude_rate_contradictions,
        counts.current_contradictions
    )?;
    writeln!(
        out,
        "reports: {}, {} from others, {} rejected, {} line errors",
        counts.attitude_reports,
        counts.attitude_of_other_senders,
        counts.attitude_frames_rejected,
        counts.attitude_line_errors
    )?;
    writeln!(
        out,
        "sentences: {}, {} empty, {} not sent; readings: {} unpaired, {} dropped",
        counts.messages, counts.messages_empty, counts.write_errors, counts.unpaired_readings, counts.samples_dropped
    )?;
    writeln!(out, "saves: {}, {} failed", counts.saves, counts.store_errors)
}

struct CoverageText<'a>(&'a PartCoverage);

impl Display for CoverageText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PartCoverage { fit_count: samples, held_back_count: held_back, covered_sector_count: sectors, percent } =
            *self.0;
        write!(f, "{percent} %, {sectors} of {SECTOR_COUNT} sectors, {samples} samples, {held_back} held back")
    }
}

pub(super) struct ResetText<'a>(pub &'a ResetCause);

impl Display for ResetText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            ResetCause::PowerOn => f.write_str("power-on"),
            ResetCause::Pin => f.write_str("reset pin"),
            ResetCause::Software => f.write_str("reboot"),
            ResetCause::Watchdog => f.write_str("watchdog"),
            ResetCause::Panic(report) => write!(f, "panic: {}", report.message),
        }
    }
}
