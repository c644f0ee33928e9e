//! `status`: everything there is to know.

use core::fmt::{self, Display, Write};

use super::calibration::{Judged, latency};
use super::settings::{Line, field_model, setting_line};
use super::{Moved, Reason, Reset};
use crate::calibration::CURRENT_IS_LOOKED_FOR;
use crate::calibration::ladder::Procedure;
use crate::collection::dataset::{Coverage, SECTORS};
use crate::compass::{Prospect, Report, State};
use crate::frames::Attitude;
use crate::health::{Counts, Health, StackUse};
use crate::settings::ProtocolKind;
use crate::wire::decimal::{AsTyped, Decimal};

/// `status`.
///
/// # Errors
///
/// What `out` says.
pub fn status(out: &mut impl Write, report: &Report, health: &Health) -> fmt::Result {
    writeln!(out, "ok {}", report.state.name())?;
    heading_lines(out, health)?;
    writeln!(out, "armed: {}", report.is_armed.map_or("not known", |armed| if armed { "yes" } else { "no" }))?;
    current(out, health.current_a)?;
    progress(out, report)?;
    if let (State::Collecting, Procedure::Flight) = (report.state, report.progress.procedure) {
        prospect(out, report.prospect.as_ref(), report.settings.accuracy_deg)?;
    }
    match &report.current {
        Some(record) => {
            writeln!(out, "calibration: number {}, {}", record.serial, Judged(&record.verdict()))?;
            latency(out, &record.calibration, record.quality.latency)?;
        }
        None => writeln!(out, "calibration: none")?,
    }
    match &report.last {
        Some(Ok(_)) => writeln!(out, "last solve: ok")?,
        Some(Err(refusal)) => {
            writeln!(out, "last solve: {}: {}", refusal.code(), Reason(refusal, health.loss))?;
        }
        None => writeln!(out, "last solve: none")?,
    }
    for line in Line::ALL {
        setting_line(out, line, ": ", report)?;
        if let Line::Port(port) = line {
            spoken(out, report.settings.ports.of(port).protocol, health.port(port))?;
        }
        if matches!(line, Line::Vision) && report.settings.tells_vision && !ProtocolKind::Mavlink.is_here() {
            out.write_str(", not in this firmware")?;
        }
        writeln!(out)?;
    }
    field_model(out, &report.here)?;
    counters(out, &health.counts)?;
    if let Some(StackUse { used, size }) = health.stack {
        writeln!(out, "stack: {used} of {size} bytes used at most")?;
    }
    writeln!(out, "up: {} s, started by {}", health.uptime_s, Reset(&health.reset))
}

/// The current that the motors draw.
fn current(out: &mut impl Write, current_a: Option<f32>) -> fmt::Result {
    match current_a {
        Some(amperes) => writeln!(out, "current: {} A", Decimal::<1>(amperes)),
        None if CURRENT_IS_LOOKED_FOR => writeln!(out, "current: not told"),
        None => writeln!(out, "current: not in this firmware"),
    }
}

/// What stands in for a protocol that this firmware does not have, and what was found on a port that finds out.
fn spoken(out: &mut impl Write, chosen: ProtocolKind, spoken: ProtocolKind) -> fmt::Result {
    if !chosen.is_here() {
        write!(out, ", not in this firmware, so {}", chosen.in_force().name())?;
    }
    match (chosen.in_force(), spoken) {
        (ProtocolKind::Auto, ProtocolKind::Auto) => out.write_str(", nobody heard yet"),
        (ProtocolKind::Auto, spoken) => write!(out, ", found {}", spoken.name()),
        _ => Ok(()),
    }
}

fn progress(out: &mut impl Write, report: &Report) -> fmt::Result {
    let progress = &report.progress;
    let by_itself = if report.is_auto { ", by itself" } else { "" };
    let waits = if report.awaits_arming { ", when the autopilot arms" } else { "" };
    writeln!(out, "collection: {}{by_itself}{waits}", progress.procedure.name())?;
    match progress.procedure {
        Procedure::Turns => {
            writeln!(out, "left: {}", Side(&progress.left))?;
            writeln!(out, "right: {}", Side(&progress.right))?;
            writeln!(out, "level: {}", Side(&progress.level))
        }
        Procedure::Level => writeln!(out, "level: {}", Side(&progress.level)),
        Procedure::Swing => {
            writeln!(out, "marks: {}", progress.marks)?;
            writeln!(out, "level: {}", Side(&progress.level))
        }
        Procedure::Flight | Procedure::Tumble => {
            let Coverage { samples, held_back, .. } = progress.left;
            writeln!(out, "attitudes: {samples} samples, {held_back} held back")
        }
    }
}

/// How good a collection in flight is by now, and what it lacks.
fn prospect(out: &mut impl Write, prospect: Option<&Prospect>, wanted_deg: f32) -> fmt::Result {
    out.write_str("collecting: ")?;
    let Some(Prospect { expected_deg, missing, is_at_floor, is_stalled, refusal }) = prospect else {
        return writeln!(out, "not tried yet");
    };
    if let Some(expected_deg) = *expected_deg {
        write!(out, "expected {} deg, wanted {}", Decimal::<1>(expected_deg), AsTyped(wanted_deg, 1))?;
    }
    match (missing, refusal) {
        (Some(manoeuvre), _) => write!(out, "; missing: {manoeuvre}")?,
        (None, _) if *is_at_floor => out.write_str("; more of the same would not help, see set attitude-error")?,
        (None, _) if *is_stalled => out.write_str("; more of the same does not help")?,
        (None, None) => out.write_str("; go on")?,
        (None, Some(_)) => {}
    }
    match refusal {
        Some(refusal) if expected_deg.is_none() || !refusal.is_for_want_of_samples() => {
            writeln!(out, "{}{}: {refusal}", if expected_deg.is_some() { "; " } else { "" }, refusal.code())
        }
        _ => writeln!(out),
    }
}

fn heading_lines(out: &mut impl Write, health: &Health) -> fmt::Result {
    match health.sensor {
        Some(identity) => writeln!(out, "sensor: {} at {:02x}", identity.model.name(), identity.address)?,
        None => writeln!(out, "sensor: not found")?,
    }
    match health.attitude {
        Some(Attitude { roll_rad, pitch_rad }) => {
            let [roll, pitch] = [roll_rad, pitch_rad].map(|rad| Decimal::<1>(rad.to_degrees()));
            writeln!(out, "attitude: roll {roll} deg, pitch {pitch} deg")?;
        }
        None => writeln!(out, "attitude: none comes on any port")?,
    }
    match health.heading {
        Ok(heading) => {
            let [heading_deg, sigma_deg] = [heading.magnetic_deg(), heading.sigma_deg()].map(Decimal::<1>);
            writeln!(out, "heading: {heading_deg} deg magnetic, sigma {sigma_deg} deg")
        }
        Err(why) => writeln!(out, "heading: none, {}", why.code()),
    }?;
    match &health.iron {
        Some(iron) => writeln!(out, "iron: moved by {}", Moved(iron)),
        None => writeln!(out, "iron: as calibrated, as far as is sure"),
    }
}

fn counters(out: &mut impl Write, counts: &Counts) -> fmt::Result {
    writeln!(
        out,
        "readings: {}, {} overruns, {} errors, {} upsets mended",
        counts.readings, counts.overruns, counts.sensor_errors, counts.sensor_upsets
    )?;
    writeln!(
        out,
        "not believed: {} saturated, {} clipped, {} stuck, {} spikes; attitude: {} frozen, {} spikes, {} rates",
        counts.saturated,
        counts.sensor_clipped,
        counts.sensor_stuck,
        counts.sensor_spikes,
        counts.attitude_frozen,
        counts.attitude_spikes,
        counts.attitude_rates
    )?;
    writeln!(
        out,
        "reports: {}, {} from others, {} rejected, {} line errors",
        counts.attitude_reports, counts.attitude_foreign, counts.attitude_rejected, counts.attitude_line_errors
    )?;
    writeln!(
        out,
        "sentences: {}, {} empty, {} not sent; readings: {} unpaired, {} dropped",
        counts.messages, counts.messages_empty, counts.write_errors, counts.unpaired, counts.samples_dropped
    )?;
    writeln!(out, "saves: {}, {} failed", counts.saves, counts.store_errors)
}

struct Side<'a>(&'a Coverage);

impl Display for Side<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Coverage { samples, held_back, sectors, percent } = *self.0;
        write!(f, "{percent} %, {sectors} of {SECTORS} sectors, {samples} samples, {held_back} held back")
    }
}
