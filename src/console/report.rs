//! What the console answers. Every answer begins with `ok` or `error <code>: what to do`; what comes unasked begins
//! with `note`.

use core::fmt::{self, Display, Write};

use super::LineError;
use crate::calibration::ladder::Procedure;
use crate::calibration::{Advice, Calibration, Envelope, Latency, Quality};
use crate::collection::Progress;
use crate::collection::dataset::{Coverage, SECTORS};
use crate::compass::{Command, Outcome, Refusal, Reply, Report, Summary, Verdict};
use crate::frames::Attitude;
use crate::health::{Counts, Health, Loss, ResetCause, StackUse};
use crate::instrument::Iron;
use crate::settings::{AttitudeError, Setting, Settings};
use crate::wire::decimal::{AsTyped, Decimal};

/// The firmware's version.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// `error <code>: what to do`.
///
/// # Errors
///
/// What `out` says.
pub fn error(out: &mut impl Write, code: &str, what_to_do: impl Display) -> fmt::Result {
    writeln!(out, "error {code}: {what_to_do}")
}

/// A line that means nothing.
///
/// # Errors
///
/// What `out` says.
pub fn line_error(out: &mut impl Write, line: &LineError) -> fmt::Result {
    error(out, line.code(), line)
}

/// A refusal of the state machine, with what was lost of the readings since the collection began.
///
/// # Errors
///
/// What `out` says.
pub fn refusal(out: &mut impl Write, refusal: &Refusal, loss: Option<Loss>) -> fmt::Result {
    error(out, refusal.code(), Reason(refusal, loss))
}

/// Why something was refused: where samples are wanting, what was lost of the readings is the better reason.
struct Reason<'a>(&'a Refusal, Option<Loss>);

impl Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(refusal, Some(loss)) if refusal.is_for_want_of_samples() => loss.fmt(f),
            Self(refusal, _) => refusal.fmt(f),
        }
    }
}

/// `version`.
///
/// # Errors
///
/// What `out` says.
pub fn version(out: &mut impl Write) -> fmt::Result {
    writeln!(out, "ok autoswing {VERSION}")
}

/// The greeting after a start.
///
/// # Errors
///
/// What `out` says.
pub fn greeting(out: &mut impl Write, reset: &ResetCause) -> fmt::Result {
    writeln!(out, "autoswing {VERSION}, started by {}; help lists the commands", Reset(reset))
}

/// A command that was carried out.
///
/// # Errors
///
/// What `out` says.
pub fn done(out: &mut impl Write, reply: &Reply) -> fmt::Result {
    match reply {
        Reply::Done(state) => writeln!(out, "ok {}", state.name()),
        Reply::Report(report) => writeln!(out, "ok {}", report.state.name()),
        Reply::Marked(number) => writeln!(out, "ok mark {number}"),
        Reply::Advice(advice) => advise(out, advice),
    }
}

/// `cal advise`.
fn advise(out: &mut impl Write, advice: &Advice) -> fmt::Result {
    let [expected, weakest, with_it] = [advice.expected_deg, advice.weakest_deg, advice.with_it_deg].map(Decimal::<2>);
    writeln!(out, "ok expected error {expected} deg rms")?;
    writeln!(out, "weakest: {}, {weakest} deg: {}", advice.weakest.name(), advice.weakest)?;
    let assumed = [
        (advice.assumed.soft_iron, " soft iron"),
        (advice.assumed.mounting, " mounting"),
        (advice.assumed.hard_iron, " hard iron"),
    ];
    if assumed.iter().any(|(is, _)| *is) {
        write!(out, "assumed, for want of samples:")?;
        for (_, name) in assumed.iter().filter(|(is, _)| *is) {
            out.write_str(name)?;
        }
        writeln!(out)?;
    }
    if advice.gains() {
        writeln!(out, "advice: {}: {expected} -> {with_it} deg", advice.manoeuvre)
    } else {
        writeln!(out, "advice: none; no circle would make it noticeably better")
    }
}

/// A solve has ended by itself; with what was lost of the readings since the collection began.
///
/// # Errors
///
/// What `out` says.
pub fn outcome(out: &mut impl Write, outcome: &Outcome, loss: Option<Loss>) -> fmt::Result {
    match outcome {
        Ok(verdict) => writeln!(out, "note calibrated: {}", Judged(verdict)),
        Err(refusal) => writeln!(out, "note refused {}: {}", refusal.code(), Reason(refusal, loss)),
    }
}

/// Iron in the aircraft has moved, or is back where it was.
///
/// # Errors
///
/// What `out` says.
pub fn iron(out: &mut impl Write, iron: Option<&Iron>) -> fmt::Result {
    match iron {
        Some(iron) => writeln!(out, "note iron-moved: {}", Moved(iron)),
        None => writeln!(out, "note iron-back: as calibrated again"),
    }
}

/// By how much, where to, and what to do.
struct Moved<'a>(&'a Iron);

impl Display for Moved<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Iron { change_ut, sigma_ut } = self.0;
        let axes = [("forward", "aft"), ("to the right", "to the left"), ("down", "up")];
        let (axis, &most) = change_ut
            .iter()
            .enumerate()
            .fold((0, &0.0), |most, next| if next.1.abs() > f32::abs(*most.1) { next } else { most });
        let where_to = axes.get(axis).map_or("", |(ahead, back)| if most < 0.0 { *back } else { *ahead });
        let [x, y, z] = [change_ut.x, change_ut.y, change_ut.z].map(Decimal::<1>);
        let (size, sigma) = (Decimal::<1>(change_ut.norm()), Decimal::<1>(*sigma_ut));
        write!(f, "{size} uT since the calibration, mostly {where_to} (x {x}, y {y}, z {z}, sigma {sigma}); ")?;
        f.write_str("headings allow for it; fix what moved, or calibrate anew")
    }
}

/// `status`.
///
/// # Errors
///
/// What `out` says.
pub fn status(out: &mut impl Write, report: &Report, health: &Health) -> fmt::Result {
    writeln!(out, "ok {}", report.state.name())?;
    heading_lines(out, health)?;
    writeln!(out, "armed: {}", if report.is_armed { "yes" } else { "no" })?;
    progress(out, &report.progress)?;
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
        setting_line(out, line, ": ", &report.settings)?;
        writeln!(out)?;
    }
    counters(out, &health.counts)?;
    if let Some(StackUse { used, size }) = health.stack {
        writeln!(out, "stack: {used} of {size} bytes used at most")?;
    }
    writeln!(out, "up: {} s, started by {}", health.uptime_s, Reset(&health.reset))
}

/// What is in force after a command that has changed it.
///
/// # Errors
///
/// What `out` says.
pub fn changed(out: &mut impl Write, command: Command, report: &Report) -> fmt::Result {
    match (command, &report.current) {
        (Command::Set(setting), _) => {
            out.write_str("ok ")?;
            setting_line(out, Line::of(setting), " ", &report.settings)?;
            // A calibration is of one mounting.
            let state = if let Setting::Mount(_) = setting { report.state.name() } else { "" };
            writeln!(out, "{}{state}", if state.is_empty() { "" } else { "; " })
        }
        (Command::Align(_) | Command::AlignSurely(_), _) => {
            writeln!(out, "ok align {} deg, added to every heading", AsTyped(report.settings.align_deg, 1))
        }
        (Command::CalUndo, Some(record)) => {
            writeln!(out, "ok {}: {}", report.state.name(), Numbered(record))
        }
        _ => writeln!(out, "ok {}", report.state.name()),
    }
}

/// Settings that are told together.
#[derive(Clone, Copy)]
enum Line {
    Stream,
    Declination,
    Inclination,
    Mount,
    AttitudeError,
}

impl Line {
    const ALL: [Self; 5] = [Self::Stream, Self::Declination, Self::Inclination, Self::Mount, Self::AttitudeError];

    const fn of(setting: Setting) -> Self {
        match setting {
            Setting::StreamOn(_) | Setting::StreamRateHz(_) | Setting::StreamHeading(_) => Self::Stream,
            Setting::Declination(_) => Self::Declination,
            Setting::Inclination(_) => Self::Inclination,
            Setting::Mount(_) => Self::Mount,
            Setting::AttitudeError(_) => Self::AttitudeError,
        }
    }
}

/// Some settings, with what stands between their name and them.
fn setting_line(out: &mut impl Write, line: Line, between: &str, settings: &Settings) -> fmt::Result {
    match line {
        Line::Stream => {
            let on = if settings.stream_on { "on" } else { "off" };
            let (rate_hz, heading) = (settings.stream_rate_hz, settings.stream_heading.name());
            write!(out, "stream{between}{on}, {rate_hz} Hz, {heading} heading")
        }
        Line::Declination => degrees(out, "declination", between, settings.declination_deg, "not set"),
        Line::Inclination => {
            degrees(out, "inclination", between, settings.inclination_deg, "not set, found from the samples")
        }
        Line::Mount => {
            write!(out, "mount{between}{}, align {} deg", settings.mount.name(), Decimal::<1>(settings.align_deg))
        }
        Line::AttitudeError => {
            let AttitudeError { bias_deg, bank_percent } = settings.attitude_error;
            let (bias, bank) = (AsTyped(bias_deg, 2), AsTyped(bank_percent, 1));
            write!(out, "attitude-error{between}{bias} deg, {bank} % of bank, 1 sigma")
        }
    }
}

fn degrees(out: &mut impl Write, name: &str, between: &str, deg: Option<f32>, without: &str) -> fmt::Result {
    match deg {
        Some(deg) => write!(out, "{name}{between}{} deg", AsTyped(deg, 1)),
        None => write!(out, "{name}{between}{without}"),
    }
}

fn progress(out: &mut impl Write, progress: &Progress) -> fmt::Result {
    writeln!(out, "collection: {}", progress.procedure.name())?;
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
        Procedure::Tumble => {
            let Coverage { samples, held_back, .. } = progress.left;
            writeln!(out, "attitudes: {samples} samples, {held_back} held back")
        }
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
        None => writeln!(out, "attitude: none, no MAVLink ATTITUDE comes")?,
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

/// `cal show`.
///
/// # Errors
///
/// What `out` says.
pub fn calibration(out: &mut impl Write, report: &Report) -> fmt::Result {
    let Some(record) = &report.current else {
        return error(out, "no-calibration", "nothing is stored; cal start, then fly left and right turns");
    };
    writeln!(out, "ok {}", Numbered(record))?;
    coefficients(out, record)?;
    let before = if report.has_previous { "kept, cal undo brings it back" } else { "none" };
    writeln!(out, "before: {before}")
}

fn coefficients(out: &mut impl Write, record: &Summary) -> fmt::Result {
    let calibration = &record.calibration;
    for (name, row) in ["wx", "wy", "wz"].iter().zip(&calibration.w) {
        let [x, y, z] = row.map(Decimal::<5>);
        writeln!(out, "{name}: {x:>9} {y:>9} {z:>9}")?;
    }
    let [x, y, z] = calibration.b_ut.map(Decimal::<3>);
    writeln!(out, "b: {x} {y} {z} uT")?;
    let inclination = Decimal::<2>(calibration.inclination_rad.to_degrees());
    writeln!(out, "field: {} uT, inclination {inclination} deg", Decimal::<2>(calibration.total_ut))?;
    let quality = &record.quality;
    writeln!(
        out,
        "fit: {} samples, norm {} %, inclination {} deg",
        quality.samples,
        Decimal::<2>(quality.norm_residual * 100.0),
        Decimal::<2>(quality.dip_residual_deg)
    )?;
    latency(out, calibration, quality.latency)?;
    writeln!(
        out,
        "sensor: {} at {:02x}, mount {}",
        record.sensor.model.name(),
        record.sensor.address,
        record.mount.name()
    )
}

/// How much older the attitude is than the source's own latency says: what is used of it, or else what was found.
fn latency(out: &mut impl Write, calibration: &Calibration, found: Option<Latency>) -> fmt::Result {
    let Some(Latency { found_s, sigma_s }) = found else { return writeln!(out, "latency: not known") };
    let (shown_s, used) =
        if calibration.uses_latency() { (calibration.latency_s, "used") } else { (found_s, "not used") };
    let [shown_ms, sigma_ms] = [shown_s, sigma_s].map(|seconds| Decimal::<0>(seconds * 1e3));
    writeln!(out, "latency: {shown_ms} ms, sigma {sigma_ms} ms, {used}")
}

/// Which one, and what to expect of it.
struct Numbered<'a>(&'a Summary);

impl Display for Numbered<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Summary { serial, quality, .. } = self.0;
        write!(f, "number {serial} of {}, {}", quality.method.name(), Expected(quality))
    }
}

struct Expected<'a>(&'a Quality);

impl Display for Expected<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rms, worst) = (Decimal::<2>(self.0.expected_rms_deg), Decimal::<2>(self.0.expected_worst_deg));
        let envelope = match self.0.envelope {
            Envelope::Banked => "",
            Envelope::Level => ", level only",
        };
        write!(f, "expected error {rms} deg rms, sigma {worst} deg at the worst heading{envelope}")
    }
}

/// What to expect, and what it rests on.
struct Judged<'a>(&'a Verdict);

impl Display for Judged<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Expected(&self.0.quality).fmt(f)?;
        match self.0.attitude_cost {
            Some(cost) => write!(f, "; a degree of attitude error costs {} deg", Decimal::<2>(cost)),
            None => Ok(()),
        }
    }
}

struct Side<'a>(&'a Coverage);

impl Display for Side<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Coverage { samples, held_back, sectors, percent } = *self.0;
        write!(f, "{percent} %, {sectors} of {SECTORS} sectors, {samples} samples, {held_back} held back")
    }
}

struct Reset<'a>(&'a ResetCause);

impl Display for Reset<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            ResetCause::PowerOn => f.write_str("power-on"),
            ResetCause::Pin => f.write_str("reset pin"),
            ResetCause::Software => f.write_str("reboot"),
            ResetCause::Watchdog => f.write_str("watchdog"),
            ResetCause::Panic(words) => write!(f, "panic: {words}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Orientation;

    /// What is used is said to be, with the number in use; what was only found is not used; and without rates nothing is
    /// known.
    #[test]
    fn a_latency_is_said_to_be_used_or_not() {
        let said = |latency_s: f32, found: Option<Latency>| {
            let calibration = Calibration { latency_s, ..Calibration::uncalibrated(Orientation::NONE) };
            let mut out = heapless::String::<64>::new();
            latency(&mut out, &calibration, found).unwrap();
            out
        };
        let found = |found_s: f32| Some(Latency { found_s, sigma_s: 0.0031 });
        assert_eq!(said(0.0412, found(0.0424)), "latency: 41 ms, sigma 3 ms, used\n");
        assert_eq!(said(-0.066, found(-0.066)), "latency: -66 ms, sigma 3 ms, used\n");
        assert_eq!(said(0.0, found(0.0084)), "latency: 8 ms, sigma 3 ms, not used\n");
        assert_eq!(said(0.0, None), "latency: not known\n");
    }
}
