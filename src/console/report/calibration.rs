//! A calibration: its coefficients, what to expect of it, and what would make it better.

use core::fmt::{self, Display, Write};

use super::error;
use crate::calibration::{Advice, Calibration, CurrentIron, Envelope, Latency, Quality};
use crate::compass::{Report, Summary, Verdict};
use crate::wire::decimal::Decimal;

/// `cal show`.
///
/// # Errors
///
/// What `out` says.
pub fn calibration(out: &mut impl Write, report: &Report) -> fmt::Result {
    let Some(record) = &report.current else {
        return error(
            out,
            "no-calibration",
            "nothing is stored; cal start, then fly, and status tells what is missing",
        );
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
    current(out, &calibration.current)?;
    writeln!(
        out,
        "sensor: {} at {:02x}, mount {}",
        record.sensor.model.name(),
        record.sensor.address,
        record.mount.name()
    )
}

/// How much older the attitude is than the source's own latency says: what is used of it, or else what was found.
pub(super) fn latency(out: &mut impl Write, calibration: &Calibration, found: Option<Latency>) -> fmt::Result {
    let Some(Latency { found_s, sigma_s }) = found else { return writeln!(out, "latency: not known") };
    let (shown_s, used) =
        if calibration.uses_latency() { (calibration.latency_s, "used") } else { (found_s, "not used") };
    let [shown_ms, sigma_ms] = [shown_s, sigma_s].map(|seconds| Decimal::<0>(seconds * 1e3));
    writeln!(out, "latency: {shown_ms} ms, sigma {sigma_ms} ms, {used}")
}

/// What each ampere adds to the field, where that is used, and by which currents it was sought.
pub(super) fn current(out: &mut impl Write, iron: &CurrentIron) -> fmt::Result {
    if iron.spread_a == 0.0 {
        return writeln!(out, "current: not known");
    }
    let [mean_a, spread_a] = [iron.mean_a, iron.spread_a].map(Decimal::<1>);
    let ([x, y, z], sigma) = (iron.ut_per_a.map(Decimal::<3>), Decimal::<3>(iron.sigma_ut_per_a));
    let used = if iron.is_used() { "used" } else { "not used" };
    writeln!(out, "current: {x} {y} {z} uT/A, sigma {sigma}, {used}; {mean_a} A, sigma {spread_a}")
}

/// Which one, and what to expect of it.
pub(super) struct Numbered<'a>(pub &'a Summary);

impl Display for Numbered<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Summary { serial, quality, .. } = self.0;
        write!(f, "number {serial} of {}, {}", quality.method.name(), Expected(quality))
    }
}

pub(super) struct Expected<'a>(pub &'a Quality);

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
pub(super) struct Judged<'a>(pub &'a Verdict);

impl Display for Judged<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Expected(&self.0.quality).fmt(f)?;
        match self.0.attitude_cost {
            Some(cost) => write!(f, "; a degree of attitude error costs {} deg", Decimal::<2>(cost)),
            None => Ok(()),
        }
    }
}

/// `cal advise`.
pub(super) fn advise(out: &mut impl Write, advice: &Advice) -> fmt::Result {
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
        writeln!(out, "advice: none; nothing to fly would make it noticeably better")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Orientation;

    /// So that who looks at a calibration sees whether the autopilot has told a current, and what came of it.
    #[test]
    fn what_goes_with_the_current_is_said() {
        let said = |iron: CurrentIron| {
            let mut out = heapless::String::<96>::new();
            current(&mut out, &iron).unwrap();
            out
        };
        let found = CurrentIron { ut_per_a: [0.25, -0.125, 0.5], sigma_ut_per_a: 0.004, mean_a: 14.25, spread_a: 6.5 };
        assert_eq!(said(found), "current: 0.250 -0.125 0.500 uT/A, sigma 0.004, used; 14.3 A, sigma 6.5\n");
        let unused = CurrentIron { ut_per_a: [0.0; 3], ..found };
        assert_eq!(said(unused), "current: 0.000 0.000 0.000 uT/A, sigma 0.004, not used; 14.3 A, sigma 6.5\n");
        assert_eq!(said(CurrentIron::NONE), "current: not known\n");
    }

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
