//! Settings in the replies to `status` and to commands that change one.

use core::fmt::{self, Write};

use autoswing::decimal::{Decimal, ShortestDecimal};
use autoswing::earth::{EarthField, LocalField, MODEL_NAME, ModelValidity, Position};
use autoswing_module::compass::StatusReport;
use autoswing_module::settings::{Field, PORT_COUNT, SETTINGS, Setting};

/// Line of the settings of the CAN bus, which not every board has.
pub(super) const CAN_LINE: &str = "can";

/// Lines of the settings of the ports.
pub(super) const PORT_LINES: [&str; PORT_COUNT] = ["port1", "port2"];

/// Lines of settings, in the order of their first settings.
pub(super) fn setting_lines() -> impl Iterator<Item = &'static str> {
    let lines = SETTINGS.iter().map(|setting| setting.status_texts[0]);
    lines
        .clone()
        .enumerate()
        .filter(move |(index, line)| !lines.clone().take(*index).any(|earlier| earlier == *line))
        .map(|(_, line)| line)
}

/// Writes a line of settings, with `separator` after its name.
pub(super) fn write_setting_line(
    out: &mut impl Write,
    line: &str,
    mut separator: &str,
    report: &StatusReport,
) -> fmt::Result {
    out.write_str(line)?;
    for setting in SETTINGS.iter().filter(|setting| setting.status_texts[0] == line) {
        write!(out, "{separator}{}", setting.status_texts[1])?;
        write_setting_value(out, setting, report)?;
        separator = ", ";
    }
    Ok(())
}

fn write_setting_value(out: &mut impl Write, setting: &Setting, report: &StatusReport) -> fmt::Result {
    let settings = &mut { report.settings };
    match (setting.field)(settings) {
        Field::Choice(choice) => out.write_str(choice.nth_name(choice.number()).unwrap_or_default()),
        // Only the number of a CAN node can be 0.
        Field::Whole(0) => out.write_str("by allocation"),
        Field::Whole(number) => write!(out, "{number} {}", setting.unit),
        Field::Number(number) => write!(out, "{} {}", ShortestDecimal(*number, 1), setting.unit),
        Field::Angle(angle_deg) => {
            write_angle(out, *angle_deg, report.local_field.model_field().and_then(setting.model_angle))
        }
        Field::Key(key) => out.write_str(if key.is_some() { "on" } else { "off" }),
    }
}

/// Writes the entered value, otherwise that of the field model.
fn write_angle(out: &mut impl Write, entered_deg: Option<f32>, by_model_deg: Option<f32>) -> fmt::Result {
    match (entered_deg, by_model_deg) {
        (Some(deg), _) => write!(out, "{} deg", ShortestDecimal(deg, 1)),
        (None, Some(deg)) => write!(out, "{} deg, by the field model", Decimal::<1>(deg)),
        (None, None) => out.write_str("not set"),
    }
}

/// Writes the field model's validity, date and position, and the field there.
pub(super) fn write_field_model(out: &mut impl Write, here: &LocalField) -> fmt::Result {
    write!(out, "field model: {MODEL_NAME}, ")?;
    out.write_str(match here.validity() {
        None => "no date yet",
        Some(ModelValidity::TooEarly) => "not used before 2025-01-01",
        Some(ModelValidity::Valid) => "valid until 2029-12-31",
        Some(ModelValidity::Extrapolated) => "too old since 2029-12-31, used until 2034-12-31",
        Some(ModelValidity::TooOld) => "too old, not used since 2034-12-31",
    })?;
    if let Some(day) = here.date() {
        let (year, month, day) = day.year_month_day();
        write!(out, "; {year}-{month:02}-{day:02}")?;
    }
    match here.model_position() {
        None => out.write_str(", no position yet")?,
        Some(Position { latitude_deg, longitude_deg, .. }) => {
            let north = hemisphere_word(latitude_deg, "N", "S");
            let east = hemisphere_word(longitude_deg, "E", "W");
            write!(out, ", {} {north} {} {east}", Decimal::<1>(latitude_deg.abs()), Decimal::<1>(longitude_deg.abs()))?;
        }
    }
    if let Some(EarthField { declination_deg, total_ut, .. }) = here.model_field() {
        write!(out, ", {} uT", Decimal::<1>(*total_ut))?;
        if declination_deg.is_none() {
            out.write_str(", no declination so near to a magnetic pole")?;
        }
    }
    writeln!(out)
}

const fn hemisphere_word(deg: f32, positive: &'static str, negative: &'static str) -> &'static str {
    if deg < 0.0 { negative } else { positive }
}

#[cfg(test)]
mod tests {
    use super::*;
    use autoswing::earth::{Date, PositionContext};
    use autoswing::time::WrappingMillis;

    fn field_model_line(place: Option<[f32; 2]>, days: Option<u64>) -> String {
        let mut local_field = LocalField::UNKNOWN;
        if let Some([latitude_deg, longitude_deg]) = place {
            let place = Position::new(latitude_deg, longitude_deg, 100.0).unwrap();
            local_field.update_position(WrappingMillis::default(), place, PositionContext::default());
        }
        if let Some(days) = days {
            local_field.update_date(Date::from_unix_s(days * 86_400).unwrap(), None);
        }
        let mut out = String::new();
        write_field_model(&mut out, &local_field).unwrap();
        out
    }

    #[test]
    fn the_field_model_is_shown_with_its_validity() {
        let dresden = Some([51.1, 13.7]);
        for (place, days, words) in [
            (None, None, "no date yet, no position yet"),
            (dresden, None, "no date yet, 51.1 N 13.7 E"),
            (None, Some(20_779), "valid until 2029-12-31; 2026-11-22, no position yet"),
            (dresden, Some(20_779), "valid until 2029-12-31; 2026-11-22, 51.1 N 13.7 E, 49.8 uT"),
            (Some([-33.9, -70.1]), Some(20_094), "valid until 2029-12-31; 2025-01-06, 33.9 S 70.1 W, 23.4 uT"),
            (dresden, Some(20_088), "not used before 2025-01-01; 2024-12-31, 51.1 N 13.7 E"),
            (
                dresden,
                Some(21_915),
                "too old since 2029-12-31, used until 2034-12-31; 2030-01-01, 51.1 N 13.7 E, 49.9 uT",
            ),
            (dresden, Some(23_741), "too old, not used since 2034-12-31; 2035-01-01, 51.1 N 13.7 E"),
            (
                Some([86.0, 140.0]),
                Some(20_779),
                "valid until 2029-12-31; 2026-11-22, 86.0 N 140.0 E, 57.7 uT, no declination so near to a magnetic pole",
            ),
        ] {
            assert_eq!(field_model_line(place, days), format!("field model: WMM2025, {words}\n"));
        }
    }
}
