//! Settings in the replies to `status` and to commands that change one.

use core::fmt::{self, Write};

use autoswing::decimal::{Decimal, ShortestDecimal};
use autoswing::earth::{EarthField, LocalField, MODEL_NAME, ModelValidity, Position};
use autoswing_module::compass::StatusReport;
use autoswing_module::settings::{AttitudeError, CanSettings, PortNumber, PortSettings, SensorError, SettingChange};

#[derive(Clone, Copy)]
pub(super) enum SettingGroup {
    Stream,
    Declination,
    Inclination,
    Mount,
    AttitudeError,
    SensorError,
    Accuracy,
    Auto,
    Port(PortNumber),
    Vision,
    AttitudeRate,
    Signing,
    Can,
}

impl SettingGroup {
    /// All groups but that of the CAN bus, which not every board has.
    pub const GROUPS_WITHOUT_CAN: [Self; 13] = [
        Self::Stream,
        Self::Declination,
        Self::Inclination,
        Self::Mount,
        Self::AttitudeError,
        Self::SensorError,
        Self::Accuracy,
        Self::Auto,
        Self::Port(PortNumber::One),
        Self::Port(PortNumber::Two),
        Self::Vision,
        Self::AttitudeRate,
        Self::Signing,
    ];

    pub const fn from_setting(setting: SettingChange) -> Self {
        match setting {
            SettingChange::StreamOn(_) | SettingChange::StreamRateHz(_) | SettingChange::StreamHeading(_) => {
                Self::Stream
            }
            SettingChange::Declination(_) => Self::Declination,
            SettingChange::Inclination(_) => Self::Inclination,
            SettingChange::Mount(_) => Self::Mount,
            SettingChange::AttitudeError(_) => Self::AttitudeError,
            SettingChange::SensorError(_) => Self::SensorError,
            SettingChange::Accuracy(_) => Self::Accuracy,
            SettingChange::Auto(_) => Self::Auto,
            SettingChange::Protocol(port, _) | SettingChange::Baud(port, _) => Self::Port(port),
            SettingChange::Vision(_) => Self::Vision,
            SettingChange::AttitudeRateHz(_) => Self::AttitudeRate,
            SettingChange::Signing(_) => Self::Signing,
            SettingChange::CanNode(_)
            | SettingChange::CanRateHz(_)
            | SettingChange::CanCovariance(_)
            | SettingChange::CanTermination(_) => Self::Can,
        }
    }
}

/// Writes a line of settings, with `separator` after its name.
pub(super) fn write_setting(
    out: &mut impl Write,
    group: SettingGroup,
    separator: &str,
    report: &StatusReport,
) -> fmt::Result {
    let StatusReport { settings, local_field: here, .. } = report;
    let field = here.model_field();
    match group {
        SettingGroup::Stream => {
            let stream_state = on_or_off(settings.stream_on);
            let (rate_hz, heading) = (settings.stream_rate_hz, settings.stream_heading.kind_name());
            write!(out, "stream{separator}{stream_state}, {rate_hz} Hz, {heading} heading")
        }
        SettingGroup::Declination => {
            let by_model_deg = field.and_then(|field| field.declination_deg);
            write_degrees(out, "declination", separator, [settings.declination_deg, by_model_deg], "not set")
        }
        SettingGroup::Inclination => {
            let by_model_deg = field.map(|field| field.inclination_deg);
            let unset_text = "not set, found from the samples";
            write_degrees(out, "inclination", separator, [settings.inclination_deg, by_model_deg], unset_text)
        }
        SettingGroup::Mount => {
            write!(
                out,
                "mount{separator}{}, align {} deg",
                settings.mount.orientation_name(),
                Decimal::<1>(settings.align_deg)
            )
        }
        SettingGroup::AttitudeError => {
            let AttitudeError { bias_deg, bank_percent } = settings.attitude_error;
            let (bias, bank) = (ShortestDecimal(bias_deg, 2), ShortestDecimal(bank_percent, 1));
            write!(out, "attitude-error{separator}{bias} deg, {bank} % of bank, 1 sigma")
        }
        SettingGroup::SensorError => {
            let SensorError { gyro_percent, drift_percent } = settings.sensor_error;
            let (gyro, drift) = (ShortestDecimal(gyro_percent, 1), ShortestDecimal(drift_percent, 2));
            write!(out, "sensor-error{separator}gyro {gyro} %, drift {drift} % of the field a minute, 1 sigma")
        }
        SettingGroup::Accuracy => {
            write!(out, "accuracy{separator}{} deg wanted", ShortestDecimal(settings.accuracy_deg, 1))
        }
        SettingGroup::Auto => {
            let text =
                if settings.auto_on { "collects automatically while uncalibrated" } else { "collects when asked" };
            write!(out, "auto{separator}{}, {text}", on_or_off(settings.auto_on))
        }
        SettingGroup::Port(port) => {
            let PortSettings { protocol, baud } = settings.ports.settings_of_port(port);
            write!(out, "port{}{separator}{}, {} baud", port as u8 + 1, protocol.protocol_name(), baud.baud_name())
        }
        SettingGroup::Vision => write!(out, "vision{separator}{}", on_or_off(settings.sends_vision_yaw)),
        SettingGroup::AttitudeRate => write!(out, "attitude-rate{separator}{} Hz at most", settings.attitude_rate_hz),
        SettingGroup::Signing => write!(out, "signing{separator}{}", on_or_off(settings.signing_key.is_some())),
        SettingGroup::Can => {
            let CanSettings { node, rate_hz, sends_covariance, is_terminated } = settings.can;
            write!(out, "can{separator}")?;
            match node {
                0 => out.write_str("node by allocation")?,
                node => write!(out, "node {node}")?,
            }
            let [covariance, termination] = [sends_covariance, is_terminated].map(on_or_off);
            write!(out, ", {rate_hz} Hz, covariance {covariance}, termination {termination}")
        }
    }
}

const fn on_or_off(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}

/// Writes the entered value, otherwise that of the field model.
fn write_degrees(
    out: &mut impl Write,
    name: &str,
    separator: &str,
    [entered_deg, by_model_deg]: [Option<f32>; 2],
    unset_text: &str,
) -> fmt::Result {
    write!(out, "{name}{separator}")?;
    match (entered_deg, by_model_deg) {
        (Some(deg), _) => write!(out, "{} deg", ShortestDecimal(deg, 1)),
        (None, Some(deg)) => write!(out, "{} deg, by the field model", Decimal::<1>(deg)),
        (None, None) => out.write_str(unset_text),
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
            local_field.update_date(Date::from_unix_s(days * 86_400).unwrap());
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

    #[test]
    fn degrees_are_shown_with_their_source() {
        for (degrees, words) in [
            ([Some(3.25), Some(5.16)], "declination: 3.25 deg"),
            ([None, Some(-5.16)], "declination: -5.2 deg, by the field model"),
            ([None, None], "declination: not set"),
        ] {
            let mut out = String::new();
            write_degrees(&mut out, "declination", ": ", degrees, "not set").unwrap();
            assert_eq!(out, words);
        }
    }
}
