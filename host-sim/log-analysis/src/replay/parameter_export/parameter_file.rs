//! Parameter files: text of corrections, and the correction that an autopilot reads from it.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Vector3};

use super::exported_correction::{ExportedCorrection, HeldBackScore};
use super::parameter_format::ParameterFormat;
use super::symmetric_fit::correction_parts;
use crate::log::{
    ARDUPILOT_SLOTS, CustomRotation, FieldCorrection, LoggedFlight, NumberedRotation, ParameterHistory,
    SensorOrientation, ardupilot_index, ardupilot_vector, logged_mounting, orientation_parameter, px4_mounting,
};
use crate::numbers::{UT_PER_GAUSS, UT_PER_MILLIGAUSS, format_number};

/// PX4 uses gauss per kiloampere.
const AMPERES_PER_KILOAMPERE: f64 = 1000.0;

/// Text of the parameter file with these corrections. A compass with an unknown slot has a comment instead.
#[must_use]
pub fn format_parameter_file(flight: &LoggedFlight, exports: &[ExportedCorrection], format: ParameterFormat) -> String {
    let (mut slotted, mut comments) = (Vec::new(), String::new());
    for export in exports {
        match flight.slot(export.compass_number) {
            Ok(index) => slotted.push((export, index)),
            Err(reason) => {
                // Writing to a string cannot fail.
                let _ = writeln!(comments, "# compass {}: no parameters, because {reason}", export.compass_number);
            }
        }
    }
    format_corrections(flight, &slotted, format) + &comments
}

/// Text with corrections and the slots of their parameters.
fn format_corrections(flight: &LoggedFlight, exports: &[SlottedCorrection<'_>], format: ParameterFormat) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = match format {
        ParameterFormat::ArduPilot => write_ardupilot_parameters(&mut text, flight, exports),
        ParameterFormat::Px4 => write_px4_parameters(&mut text, flight, exports),
        ParameterFormat::Inav => write_inav_parameters(&mut text, exports),
    };
    text
}

/// Correction and the index in the names of its parameters.
type SlottedCorrection<'a> = (&'a ExportedCorrection, u8);

fn write_comments(text: &mut String, export: &ExportedCorrection) -> std::fmt::Result {
    write!(text, "# compass {}", export.compass_number)?;
    if let Some(HeldBackScore { rms_deg, as_logged_rms_deg, is_estimate, .. }) = export.held_back_score {
        let estimated = if is_estimate { " (estimated)" } else { "" };
        write!(text, ": {rms_deg:.2} deg RMS on held-back rows, {as_logged_rms_deg:.2} as logged{estimated}")?;
    }
    if let Some([from_s, to_s]) = export.fitted_range_s {
        write!(text, "; fitted to {from_s:.0} to {to_s:.0} s of the log")?;
    }
    writeln!(text, "\n# {:.2} deg RMS are lost, which these parameters cannot express", export.heading_loss_deg[0])?;
    export.warnings.iter().try_for_each(|warning| writeln!(text, "# {warning}"))
}

fn write_ardupilot_parameters(
    text: &mut String,
    flight: &LoggedFlight,
    exports: &[SlottedCorrection<'_>],
) -> std::fmt::Result {
    if exports.iter().any(|(export, _)| export.has_motor_compensation()) {
        writeln!(text, "COMPASS_MOTCT,2")?;
    }
    for &(export, slot) in exports {
        write_comments(text, export)?;
        if slot != export.compass_number {
            writeln!(text, "# its parameters are those of slot {slot}, which has its device id")?;
        }
        let [offsets, diagonal, off_diagonal] = correction_parts(&export.correction);
        for (name, numbers, decimals) in [
            ("OFS", -offsets / UT_PER_MILLIGAUSS, 2),
            ("DIA", diagonal, 5),
            ("ODI", off_diagonal, 5),
            // ArduPilot adds the motor-current term after the multiplication with the matrix.
            ("MOT", -(export.correction.matrix * export.correction.motor_ut_per_a) / UT_PER_MILLIGAUSS, 3),
        ] {
            for (name, value) in ardupilot_vector(name, slot).iter().zip(numbers.iter()) {
                writeln!(text, "{name},{}", format_number(*value, decimals))?;
            }
        }
        writeln!(text, "COMPASS_SCALE{},1", ardupilot_index(slot))?;
        write_ardupilot_orientation(text, flight, export, slot)?;
    }
    Ok(())
}

/// Writes the new orientation of a slot, or that of the log.
fn write_ardupilot_orientation(
    text: &mut String,
    flight: &LoggedFlight,
    export: &ExportedCorrection,
    slot: u8,
) -> std::fmt::Result {
    let name = orientation_parameter(false, slot);
    let Some(orientation) = export.orientation.parameters else {
        let unchanged = flight.parameters.last_value(&name);
        return unchanged.map_or(Ok(()), |number| writeln!(text, "{name},{number:.0}"));
    };
    if let SensorOrientation::Custom(rotation, angles_deg) = orientation {
        if let CustomRotation::Ardupilot(_) = rotation {
            writeln!(
                text,
                "# CUST_ROT parameters appear after CUST_ROT_ENABLE 1 and a restart: then load the file again"
            )?;
            writeln!(text, "CUST_ROT_ENABLE,1")?;
        }
        for (name, angle_deg) in rotation.angle_parameters().iter().zip(angles_deg) {
            writeln!(text, "{name},{}", format_number(angle_deg, 2))?;
        }
        writeln!(text, "# restart after loading: the angles are used from then on")?;
    }
    writeln!(text, "{name},{}", orientation.number())
}

/// Whether a file may compensate the current of a compass: `COMPASS_MOTCT` is common to all compasses, and no file changes
/// it while another one needs the old value.
pub fn may_compensate_current(flight: &LoggedFlight, compass_number: u8, format: ParameterFormat) -> bool {
    const BY_THROTTLE: i32 = 1;
    /// `COMPASS_PMOTn_*`, applied to the first slot alone (`AP_Compass_Backend::correct_field`).
    const BY_MOTOR: i32 = 3;
    const PER_MOTOR_SLOT: u8 = 1;
    let parameter = |name: &str| flight.parameters.last_value(name).unwrap_or(0.0);
    let slot = flight.slot(compass_number);
    let is_compensated = |other_slot: u8| ardupilot_vector("MOT", other_slot).iter().any(|name| parameter(name) != 0.0);
    let mut other_slots = ARDUPILOT_SLOTS.filter(|other| Ok(*other) != slot);
    format != ParameterFormat::ArduPilot
        || match parameter("COMPASS_MOTCT").round() as i32 {
            BY_THROTTLE => !other_slots.any(is_compensated),
            BY_MOTOR => slot == Ok(PER_MOTOR_SLOT),
            _ => true,
        }
}

/// Vehicle, component, name, value, type (9 float, 6 integer), tab-separated.
fn write_px4_parameters(
    text: &mut String,
    flight: &LoggedFlight,
    exports: &[SlottedCorrection<'_>],
) -> std::fmt::Result {
    if exports.iter().any(|(export, _)| export.has_motor_compensation()) {
        // Type 2: compensation by the current of the first battery.
        writeln!(text, "1\t1\tCAL_MAG_COMP_TYP\t2\t6")?;
    }
    for &(export, index) in exports {
        write_comments(text, export)?;
        let mounting = export.orientation.rotation_from_logged * px4_mounting(&flight.parameters, f64::INFINITY, index);
        let to_sensor = mounting.transpose();
        let sensor = FieldCorrection {
            matrix: to_sensor * export.correction.matrix * to_sensor.transpose(),
            hard_iron_ut: to_sensor * export.correction.hard_iron_ut,
            motor_ut_per_a: to_sensor * export.correction.motor_ut_per_a,
        };
        let [offsets, diagonal, off_diagonal] = correction_parts(&sensor);
        let comp = -sensor.motor_ut_per_a / UT_PER_GAUSS * AMPERES_PER_KILOAMPERE;
        for (name, numbers) in
            [("OFF", offsets / UT_PER_GAUSS), ("SCALE", diagonal), ("ODIAG", off_diagonal), ("COMP", comp)]
        {
            for (axis, value) in ["X", "Y", "Z"].iter().zip(numbers.iter()) {
                writeln!(text, "1\t1\tCAL_MAG{index}_{axis}{name}\t{}\t9", format_number(*value, 6))?;
            }
        }
        write_px4_orientation(text, flight, export, index)?;
    }
    Ok(())
}

/// Writes the new orientation of an index, or the number of the log. Angles other than zero have priority over a number.
fn write_px4_orientation(
    text: &mut String,
    flight: &LoggedFlight,
    export: &ExportedCorrection,
    index: u8,
) -> std::fmt::Result {
    let name = orientation_parameter(true, index);
    let custom = CustomRotation::Px4(index);
    let (number, angles_deg) = match export.orientation.parameters {
        Some(orientation @ SensorOrientation::Custom(_, angles_deg)) => (orientation.number(), Some(angles_deg)),
        Some(orientation) => {
            let is_custom = custom.has_angles(&flight.parameters, f64::INFINITY);
            (orientation.number(), is_custom.then_some([0.0; 3]))
        }
        None => match flight.parameters.last_value(&name).and_then(NumberedRotation::new) {
            Some(rotation) => (rotation.rotation_number(), None),
            None => return Ok(()),
        },
    };
    writeln!(text, "1\t1\t{name}\t{number}\t6")?;
    for (name, angle_deg) in custom.angle_parameters().iter().zip(angles_deg.into_iter().flatten()) {
        writeln!(text, "1\t1\t{name}\t{}\t9", format_number(angle_deg, 2))?;
    }
    Ok(())
}

/// INAV uses driver counts in chip axes, which no log contains: written in milligauss and body axes, for an aligned
/// sensor.
fn write_inav_parameters(text: &mut String, exports: &[SlottedCorrection<'_>]) -> std::fmt::Result {
    for (export, _) in exports.iter().take(1) {
        write_comments(text, export)?;
        writeln!(text, "# milligauss, in body axes: for a driver that counts milligauss, and align_mag that is right")?;
        for (axis, (zero, gain)) in ["x", "y", "z"]
            .iter()
            .zip(export.correction.hard_iron_ut.iter().zip(export.correction.matrix.diagonal().iter()))
        {
            writeln!(text, "set magzero_{axis} = {:.0}", zero / UT_PER_MILLIGAUSS)?;
            writeln!(text, "set maggain_{axis} = {:.0}", 1024.0 / gain)?;
        }
        writeln!(text, "save")?;
    }
    Ok(())
}

/// Parses an exported file on top of other parameters.
#[must_use]
pub fn parse_parameter_file(text: &str, base_parameters: &ParameterHistory) -> ParameterHistory {
    let mut parameters = base_parameters.clone();
    for (name, value) in file_values(text) {
        if let Ok(value) = value.parse() {
            parameters.set_value(f64::MAX, name, value);
        }
    }
    parameters
}

/// Names and values of the parameters in a file.
pub(in crate::replay) fn file_values(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.lines().filter(|line| !line.starts_with('#')).filter_map(|line| {
        let cells: Vec<&str> = line.split([',', '\t']).collect();
        let ([name, value] | [_, _, name, value, _]) = *cells.as_slice() else { return None };
        Some((name, value))
    })
}

/// Rotation from the logged body axes to those of the body, and the correction after it, as the autopilot reads them from
/// the file with this correction: with its digits.
pub(super) fn correction_by_file(
    flight: &LoggedFlight,
    export: &ExportedCorrection,
    format: ParameterFormat,
) -> (Matrix3<f64>, FieldCorrection) {
    // The result is the same for every slot; without a known one, the first is written.
    let slot = flight.slot(export.compass_number).unwrap_or(u8::from(format == ParameterFormat::ArduPilot));
    let text = format_corrections(flight, &[(export, slot)], format);
    let parameters = parse_parameter_file(&text, &flight.parameters);
    let is_px4 = format == ParameterFormat::Px4;
    let correction = match format {
        ParameterFormat::ArduPilot => FieldCorrection::from_ardupilot(&parameters, slot),
        ParameterFormat::Px4 => FieldCorrection::from_px4(&parameters, slot),
        ParameterFormat::Inav => return (export.orientation.rotation_from_logged, inav_correction(&text)),
    };
    let [before, after] = [&flight.parameters, &parameters].map(|of| logged_mounting(of, is_px4, f64::INFINITY, slot));
    let rotation = before.zip(after).map_or_else(Matrix3::identity, |(before, after)| after * before.transpose());
    (rotation, correction)
}

/// INAV's `(raw - zero) 1024 / gain`, in milligauss.
fn inav_correction(text: &str) -> FieldCorrection {
    let values = |name: &str, unset: f64| {
        Vector3::from(["x", "y", "z"].map(|axis| {
            let prefix = format!("set {name}_{axis} = ");
            text.lines().find_map(|line| line.strip_prefix(&prefix)?.parse::<f64>().ok()).unwrap_or(unset)
        }))
    };
    let scale = values("maggain", 1024.0).map(|gain| 1024.0 / gain);
    FieldCorrection::without_current(Matrix3::from_diagonal(&scale), values("magzero", 0.0) * UT_PER_MILLIGAUSS)
}
