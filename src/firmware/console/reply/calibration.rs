//! Replies about a calibration: coefficients, expected accuracy, possible improvements.

use core::fmt::{self, Display, Write};

use super::error::write_refusal;
use autoswing::calibration::{Advice, AttitudeLatency, Calibration, MotorCurrentInterference};
use autoswing::decimal::Decimal;
use autoswing_module::compass::{CalibrationSummary, StatusReport};
use autoswing_module::messages::{ExpectedErrorText, Refusal};

/// Writes the reply to `cal show`.
pub(super) fn write_calibration(out: &mut impl Write, report: &StatusReport) -> fmt::Result {
    let Some(record) = &report.stored_calibration else { return write_refusal(out, &Refusal::NoStoredCalibration) };
    writeln!(out, "ok {}", CalibrationTitle(record))?;
    write_coefficients(out, record)?;
    let previous_text = if report.can_undo { "kept, cal undo brings it back" } else { "none" };
    writeln!(out, "before: {previous_text}")
}

fn write_coefficients(out: &mut impl Write, record: &CalibrationSummary) -> fmt::Result {
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
        Decimal::<2>(quality.inclination_residual_deg)
    )?;
    write_latency(out, calibration, quality.latency)?;
    write_interference(out, &calibration.motor_current)?;
    writeln!(out, "sensor: {}, mount {}", record.sensor, record.mount.orientation_name())
}

/// Writes the attitude latency in excess of that reported by the source: the applied one, otherwise the estimate.
pub(super) fn write_latency(
    out: &mut impl Write,
    calibration: &Calibration,
    estimate: Option<AttitudeLatency>,
) -> fmt::Result {
    let Some(AttitudeLatency { estimate_s: found_s, sigma_s }) = estimate else {
        return writeln!(out, "latency: not known");
    };
    let (shown_s, use_text) =
        if calibration.uses_latency() { (calibration.latency_s, "used") } else { (found_s, "not used") };
    let [shown_ms, sigma_ms] = [shown_s, sigma_s].map(|seconds| Decimal::<0>(seconds * 1e3));
    writeln!(out, "latency: {shown_ms} ms, sigma {sigma_ms} ms, {use_text}")
}

/// Writes the motor-current interference, whether it is applied, and the currents it was estimated from.
pub(super) fn write_interference(out: &mut impl Write, interference: &MotorCurrentInterference) -> fmt::Result {
    if interference.current_sigma_a == 0.0 {
        return writeln!(out, "current: not known");
    }
    let [mean_a, sigma_a] = [interference.mean_current_a, interference.current_sigma_a].map(Decimal::<1>);
    let ([x, y, z], sigma) = (interference.ut_per_a.map(Decimal::<3>), Decimal::<3>(interference.sigma_ut_per_a));
    let use_text = if interference.is_applied() { "used" } else { "not used" };
    writeln!(out, "current: {x} {y} {z} uT/A, sigma {sigma}, {use_text}; {mean_a} A, sigma {sigma_a}")
}

pub(super) struct CalibrationTitle<'a>(pub &'a CalibrationSummary);

impl Display for CalibrationTitle<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let CalibrationSummary { serial_number: serial, quality, .. } = self.0;
        write!(f, "number {serial} of {}, {}", quality.method.method_name(), ExpectedErrorText(quality))
    }
}

pub(super) fn write_advice(out: &mut impl Write, advice: &Advice) -> fmt::Result {
    let [expected, weakest, expected_after] =
        [advice.expected_deg, advice.weakest_deviation_deg, advice.expected_after_deg].map(Decimal::<2>);
    writeln!(out, "ok expected error {expected} deg rms")?;
    writeln!(
        out,
        "weakest: {}, {weakest} deg: {}",
        advice.weakest_deviation.deviation_name(),
        advice.weakest_deviation
    )?;
    let assumed = [
        (advice.unobservable.soft_iron, " soft iron"),
        (advice.unobservable.mounting, " mounting"),
        (advice.unobservable.hard_iron, " hard iron"),
    ];
    if assumed.iter().any(|(is, _)| *is) {
        write!(out, "assumed, no samples:")?;
        for (_, name) in assumed.iter().filter(|(is, _)| *is) {
            out.write_str(name)?;
        }
        writeln!(out)?;
    }
    if advice.is_worthwhile() {
        writeln!(out, "advice: {}: {expected} -> {expected_after} deg", advice.manoeuvre)
    } else {
        writeln!(out, "advice: none; nothing to fly would make it noticeably better")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use autoswing::calibration::Orientation;

    /// The reply shows whether the autopilot reported a current, and the estimated interference.
    #[test]
    fn motor_current_interference_is_reported() {
        let line = |interference: MotorCurrentInterference| {
            let mut out = heapless::String::<96>::new();
            write_interference(&mut out, &interference).unwrap();
            out
        };
        let found = MotorCurrentInterference {
            ut_per_a: [0.25, -0.125, 0.5],
            sigma_ut_per_a: 0.004,
            mean_current_a: 14.3,
            current_sigma_a: 6.5,
        };
        assert_eq!(line(found), "current: 0.250 -0.125 0.500 uT/A, sigma 0.004, used; 14.3 A, sigma 6.5\n");
        let unapplied = MotorCurrentInterference { ut_per_a: [0.0; 3], ..found };
        assert_eq!(line(unapplied), "current: 0.000 0.000 0.000 uT/A, sigma 0.004, not used; 14.3 A, sigma 6.5\n");
        assert_eq!(line(MotorCurrentInterference::NO_INTERFERENCE), "current: not known\n");
    }

    /// An applied latency is shown with its value; an estimate is not applied; without rates the latency is unknown.
    #[test]
    fn attitude_latency_is_reported_as_used_or_not() {
        let line = |latency_s: f32, found: Option<AttitudeLatency>| {
            let calibration = Calibration { latency_s, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) };
            let mut out = heapless::String::<64>::new();
            write_latency(&mut out, &calibration, found).unwrap();
            out
        };
        let found = |found_s: f32| Some(AttitudeLatency { estimate_s: found_s, sigma_s: 0.0031 });
        assert_eq!(line(0.0412, found(0.0424)), "latency: 41 ms, sigma 3 ms, used\n");
        assert_eq!(line(-0.066, found(-0.066)), "latency: -66 ms, sigma 3 ms, used\n");
        assert_eq!(line(0.0, found(0.0084)), "latency: 8 ms, sigma 3 ms, not used\n");
        assert_eq!(line(0.0, None), "latency: not known\n");
    }
}
