//! Exports the module's solution as autopilot parameters.
//!
//! A solution is `h = W (m - b)` in body axes. Autopilots have a symmetric matrix: of the polar decomposition
//! `W = R S`, rotation times symmetric matrix, they can express `S` only. A rotation close to a right-angle mounting
//! goes into the orientation parameter.

use std::fmt::Write as _;

use autoswing::calibration::Calibration;
use nalgebra::{Matrix3, SVD, Vector3};

use super::symmetric_fit::{SymmetricFit, correction_parts, heading_deg};
use crate::log::{
    ARDUPILOT_SLOTS, AutopilotKind, CompassSlot, FieldCorrection, LoggedFlight, NumberedRotation, ParameterHistory,
    ardupilot_index, external_parameter, px4_mounting,
};
use crate::numbers::{format_number, square};
use crate::replay::row::ReplayRow;
use crate::score::wrap_180;

/// Format of a parameter file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterFormat {
    /// ArduPilot `COMPASS_*`, name and value a line.
    ArduPilot,
    /// PX4 `CAL_MAGn_*`, as QGroundControl loads them.
    Px4,
    /// INAV command lines.
    Inav,
}

impl ParameterFormat {
    /// The format of the autopilot that wrote the log.
    #[must_use]
    pub const fn for_autopilot(autopilot: AutopilotKind) -> Self {
        match autopilot {
            AutopilotKind::Px4 => Self::Px4,
            AutopilotKind::ArduPilot | AutopilotKind::Unknown => Self::ArduPilot,
        }
    }

    /// Name of the parameter file.
    #[must_use]
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::ArduPilot | Self::Px4 => "compass.param",
            Self::Inav => "compass.txt",
        }
    }
}

/// Heading error of parameters on held-back rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBackScore {
    /// Heading error with the parameters, degrees RMS less mean.
    pub rms_deg: f64,
    /// Heading error as logged, on the same rows, degrees RMS less mean.
    pub as_logged_rms_deg: f64,
    /// Whether both heading errors are estimated from strength and inclination of the corrected field, because the log
    /// has no reference heading.
    pub is_estimate: bool,
    /// Heading error that corresponds to the scatter of the corrected strength, degrees RMS. Errors of the attitude do
    /// not contribute: a large value is a disturbed field.
    pub field_scatter_deg: f64,
}

/// A solution in the form an autopilot can express.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportedCorrection {
    /// Number of the compass, from 1.
    pub compass_number: u8,
    /// Correction of the field after `rotation_from_logged`, body axes.
    pub correction: FieldCorrection,
    /// Rotation of the sensor relative to the logged mounting, body axes.
    pub rotation_from_logged: NumberedRotation,
    /// Heading difference to the full solution, degrees: RMS less mean, and mean.
    pub heading_loss_deg: [f64; 2],
    /// First and last row fitted, seconds.
    pub fitted_range_s: Option<[f64; 2]>,
    /// Heading error on held-back rows.
    pub held_back_score: Option<HeldBackScore>,
    /// Warnings: interference that parameters cannot express, and values that the autopilot would reject.
    pub warnings: Vec<String>,
}

/// ArduPilot's default of `COMPASS_OFFS_MAX`, milligauss.
const DEFAULT_MAX_OFFSET_MG: f64 = 1800.0;

const MILLIGAUSS_PER_UT: f64 = 10.0;
const GAUSS_PER_UT: f64 = 0.01;
/// PX4 uses gauss per kiloampere.
const AMPERES_PER_KILOAMPERE: f64 = 1000.0;

impl ExportedCorrection {
    fn has_motor_compensation(&self) -> bool {
        self.correction.motor_ut_per_a != Vector3::zeros()
    }

    /// Largest offset component of the exported correction, milligauss.
    pub(super) fn largest_offset_mg(&self) -> f64 {
        self.correction.hard_iron_ut.amax() * MILLIGAUSS_PER_UT
    }

    /// Limit of the offsets that the autopilot rejects, milligauss, if exceeded.
    pub(super) fn offset_limit_mg_if_exceeded(&self, flight: &LoggedFlight, format: ParameterFormat) -> Option<f64> {
        let limit_mg = flight.parameters.last_value("COMPASS_OFFS_MAX").unwrap_or(DEFAULT_MAX_OFFSET_MG);
        (format == ParameterFormat::ArduPilot && self.largest_offset_mg() > limit_mg).then_some(limit_mg)
    }
}

/// Converts a calibration of a compass, with the rows that it is for. `total_ut` is the Earth's field strength, if
/// known.
#[must_use]
pub(super) fn export_correction(
    compass_number: u8,
    rows: &[ReplayRow],
    calibration: &Calibration,
    total_ut: Option<f64>,
    format: ParameterFormat,
) -> Option<ExportedCorrection> {
    let correction_matrix = calibration.w_matrix().map(f64::from);
    let hard_iron_ut = calibration.b_vector_ut().map(f64::from);
    let (rotation, symmetric) = polar_decomposition(&correction_matrix)?;
    let mounting = nearest_mounting(&rotation);
    let mounting_matrix = mounting.rotation_matrix();
    let scale = total_ut.map_or(1.0, |total_ut| total_ut / f64::from(calibration.total_ut));
    let rotated_rows: Vec<ReplayRow> = rows.iter().map(|row| row.in_rotated_axes(&mounting_matrix)).collect();
    let motor_ut_per_a = Vector3::from(calibration.motor_current.ut_per_a).map(f64::from);
    let full_correction = FieldCorrection { matrix: correction_matrix, hard_iron_ut, motor_ut_per_a };
    // INAV has no current compensation; the mean interference goes into the offsets.
    let offset_current_a =
        if format == ParameterFormat::Inav { f64::from(calibration.motor_current.mean_current_a) } else { 0.0 };
    let initial_correction = FieldCorrection {
        matrix: mounting_matrix * symmetric * mounting_matrix.transpose() * scale,
        hard_iron_ut: mounting_matrix * (hard_iron_ut + motor_ut_per_a * offset_current_a),
        motor_ut_per_a: if format == ParameterFormat::Inav {
            Vector3::zeros()
        } else {
            mounting_matrix * motor_ut_per_a
        },
    };
    let symmetric_fit = SymmetricFit {
        rows,
        rotated_rows: &rotated_rows,
        mounting: mounting_matrix,
        calibration,
        full_correction,
        is_diagonal: format == ParameterFormat::Inav,
    };
    let exportable = symmetric_fit.nearest_correction(initial_correction);
    let lost_deg = heading_loss_deg_of(rows, &rotated_rows, &full_correction, &exportable);
    let mut warnings = Vec::new();
    if format == ParameterFormat::Inav && calibration.motor_current.is_applied() {
        warnings.push("motor-current interference cannot be expressed".to_owned());
    }
    if mounting.rotation_number() != 0 {
        warnings.push("the mounting of the compass differs from its parameters: check the orientation".to_owned());
    }
    Some(ExportedCorrection {
        compass_number,
        correction: exportable,
        rotation_from_logged: mounting,
        heading_loss_deg: lost_deg,
        fitted_range_s: None,
        held_back_score: None,
        warnings,
    })
}

/// The field of a row, microtesla, as the autopilot corrects it by exported parameters: with the digits of the file.
pub fn field_by_exported_parameters(
    flight: &LoggedFlight,
    export: &ExportedCorrection,
    format: ParameterFormat,
) -> impl Fn(&ReplayRow) -> Vector3<f64> + use<> {
    // The result is the same for every slot; without a known one, the first is written.
    let slot = flight.slot_index(export.compass_number).unwrap_or(u8::from(format == ParameterFormat::ArduPilot));
    let text = format_corrections(flight, &[(export, slot)], format);
    let parameters = parse_parameter_file(&text, &flight.parameters);
    let correction = match format {
        ParameterFormat::ArduPilot => FieldCorrection::from_ardupilot(&parameters, slot),
        ParameterFormat::Px4 => FieldCorrection::from_px4(&parameters, slot),
        ParameterFormat::Inav => inav_correction(&text),
    };
    let rotation_matrix = export.rotation_from_logged.rotation_matrix();
    // The orientation parameter turns the field to body axes first, so that the heading is that of the body.
    move |row| row.in_rotated_axes(&rotation_matrix).corrected_field(&correction)
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
    FieldCorrection::without_current(Matrix3::from_diagonal(&scale), values("magzero", 0.0) / MILLIGAUSS_PER_UT)
}

fn polar_decomposition(matrix: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let SVD { u, v_t, singular_values } = SVD::new(*matrix, true, true);
    let (u, v_t) = (u?, v_t?);
    let turn = u * v_t;
    let symmetric = v_t.transpose() * Matrix3::from_diagonal(&singular_values) * v_t;
    (turn.determinant() > 0.0).then_some((turn, symmetric))
}

/// The right-angle mounting within 25 deg of a rotation, else the identity.
fn nearest_mounting(turn: &Matrix3<f64>) -> NumberedRotation {
    let (nearest, off_deg) = NumberedRotation::nearest_to_matrix(turn);
    let is_square = nearest.rotation_matrix().iter().all(|number| (number.abs() - 0.5).abs() > 0.49);
    if is_square && off_deg < 25.0 { nearest } else { NumberedRotation::default() }
}

/// Heading difference of two corrections over usable rows, degrees: RMS less mean, and mean.
fn heading_loss_deg_of(
    rows: &[ReplayRow],
    rotated_rows: &[ReplayRow],
    full_correction: &FieldCorrection,
    exported: &FieldCorrection,
) -> [f64; 2] {
    let differences: Vec<f64> = rows
        .iter()
        .zip(rotated_rows)
        .filter(|(row, _)| row.is_usable)
        .map(|(row, rotated_row)| wrap_180(heading_deg(rotated_row, exported) - heading_deg(row, full_correction)))
        .collect();
    let row_count = differences.len().max(1) as f64;
    let mean = differences.iter().sum::<f64>() / row_count;
    let squares = differences.iter().map(|difference| square(difference - mean)).sum::<f64>();
    [(squares / row_count).sqrt(), mean]
}

/// Text of the parameter file with these corrections. A compass with an unknown slot has a comment instead.
#[must_use]
pub fn format_parameter_file(flight: &LoggedFlight, exports: &[ExportedCorrection], format: ParameterFormat) -> String {
    let (mut slotted, mut comments) = (Vec::new(), String::new());
    for export in exports {
        let logged = flight.compasses.iter().find(|compass| compass.compass_number == export.compass_number);
        match logged.map(|compass| compass.slot).unwrap_or_default() {
            CompassSlot::Known { index, .. } => slotted.push((export, index)),
            CompassSlot::Unknown { reason } => {
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
        let index = ardupilot_index(slot);
        let [offsets, diagonal, off_diagonal] = correction_parts(&export.correction);
        for (name, numbers, decimals) in [
            ("OFS", -offsets * MILLIGAUSS_PER_UT, 2),
            ("DIA", diagonal, 5),
            ("ODI", off_diagonal, 5),
            // ArduPilot adds the motor-current term after the multiplication with the matrix.
            ("MOT", -(export.correction.matrix * export.correction.motor_ut_per_a) * MILLIGAUSS_PER_UT, 3),
        ] {
            for (axis, value) in ["X", "Y", "Z"].iter().zip(numbers.iter()) {
                writeln!(text, "COMPASS_{name}{index}_{axis},{}", format_number(*value, decimals))?;
            }
        }
        writeln!(text, "COMPASS_SCALE{index},1")?;
        let orient = format!("COMPASS_ORIENT{index}");
        if let Some(now) = flight.parameters.last_value(&orient) {
            let external = external_parameter(slot);
            let is_internal = flight.parameters.last_value(&external) == Some(0.0);
            let combined = NumberedRotation::new(now).map(|now| {
                NumberedRotation::nearest_to_matrix(
                    &(export.rotation_from_logged.rotation_matrix() * now.rotation_matrix()),
                )
            });
            match combined {
                _ if export.rotation_from_logged.rotation_number() == 0 => writeln!(text, "{orient},{now:.0}")?,
                // AHRS_ORIENTATION rotates internal compasses.
                _ if is_internal => writeln!(text, "# {orient}: not used, because {external} is 0")?,
                Some((rotation, off_deg)) if off_deg < 1.0 => {
                    writeln!(text, "{orient},{}", rotation.rotation_number())?;
                }
                _ => writeln!(text, "# {orient}: the orientation has no number")?,
            }
        }
    }
    Ok(())
}

/// Whether a file may compensate the current of a compass: `COMPASS_MOTCT` is common to all compasses, and no file changes
/// it while another one needs the old value.
pub(super) fn may_compensate_current(flight: &LoggedFlight, compass_number: u8, format: ParameterFormat) -> bool {
    const BY_THROTTLE: i32 = 1;
    /// `COMPASS_PMOTn_*`, applied to the first slot alone (`AP_Compass_Backend::correct_field`).
    const BY_MOTOR: i32 = 3;
    const PER_MOTOR_SLOT: u8 = 1;
    let parameter = |name: &str| flight.parameters.last_value(name).unwrap_or(0.0);
    let slot = flight.slot_index(compass_number);
    let is_compensated = |other_slot: u8| {
        let index = ardupilot_index(other_slot);
        ["X", "Y", "Z"].iter().any(|axis| parameter(&format!("COMPASS_MOT{index}_{axis}")) != 0.0)
    };
    let mut other_slots = ARDUPILOT_SLOTS.filter(|other| Some(*other) != slot);
    format != ParameterFormat::ArduPilot
        || match parameter("COMPASS_MOTCT").round() as i32 {
            BY_THROTTLE => !other_slots.any(is_compensated),
            BY_MOTOR => slot == Some(PER_MOTOR_SLOT),
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
        let configured_rotation =
            flight.parameters.last_value(&format!("CAL_MAG{index}_ROT")).filter(|value| *value >= 0.0);
        let mounting =
            export.rotation_from_logged.rotation_matrix() * px4_mounting(&flight.parameters, f64::INFINITY, index);
        let (combined, off_deg) = NumberedRotation::nearest_to_matrix(&mounting);
        let to_sensor = mounting.transpose();
        let sensor = FieldCorrection {
            matrix: to_sensor * export.correction.matrix * to_sensor.transpose(),
            hard_iron_ut: to_sensor * export.correction.hard_iron_ut,
            motor_ut_per_a: to_sensor * export.correction.motor_ut_per_a,
        };
        let [offsets, diagonal, off_diagonal] = correction_parts(&sensor);
        let comp = -sensor.motor_ut_per_a * GAUSS_PER_UT * AMPERES_PER_KILOAMPERE;
        for (name, numbers) in
            [("OFF", offsets * GAUSS_PER_UT), ("SCALE", diagonal), ("ODIAG", off_diagonal), ("COMP", comp)]
        {
            for (axis, value) in ["X", "Y", "Z"].iter().zip(numbers.iter()) {
                writeln!(text, "1\t1\tCAL_MAG{index}_{axis}{name}\t{}\t9", format_number(*value, 6))?;
            }
        }
        match configured_rotation {
            // Custom rotation angles in PX4's parameters are kept.
            Some(value) if off_deg < 1.0 && NumberedRotation::new(value).is_some() => {
                writeln!(text, "1\t1\tCAL_MAG{index}_ROT\t{}\t6", combined.rotation_number())?;
            }
            _ if export.rotation_from_logged.rotation_number() != 0 => {
                writeln!(text, "# CAL_MAG{index}_ROT: its orientation differs from that of its board")?;
            }
            _ => {}
        }
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
            writeln!(text, "set magzero_{axis} = {:.0}", zero * MILLIGAUSS_PER_UT)?;
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
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let cells: Vec<&str> = line.split([',', '\t']).collect();
        let ([name, value] | [_, _, name, value, _]) = *cells.as_slice() else { continue };
        if let Ok(value) = value.parse() {
            parameters.set_value(f64::MAX, name, value);
        }
    }
    parameters
}

#[cfg(test)]
mod tests {
    use autoswing::frames::Field;
    use nalgebra::Rotation3;

    use super::*;
    use crate::log::symmetric_matrix;
    use crate::replay::tests::{LEVEL_ROW_FIELD_UT, level_row};

    /// ArduPilot also has mountings at 45 deg, which no compass is given.
    #[test]
    fn a_mounting_near_a_right_angle_is_that_one() {
        for (yaw_deg, number) in [(0.0, 0), (15.0, 0), (45.0, 0), (75.0, 2), (90.0, 2), (180.0, 4)] {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), f64::to_radians(yaw_deg));
            assert_eq!(nearest_mounting(turn.matrix()).rotation_number(), number, "{yaw_deg}");
        }
        // No 45 deg mounting lies near this axis.
        let diagonal = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
        let crooked = Rotation3::from_axis_angle(&diagonal, f64::to_radians(30.0));
        let square = NumberedRotation::new(2.0).unwrap().rotation_matrix();
        assert_eq!(nearest_mounting(&(square * crooked.matrix())).rotation_number(), 0);
    }

    #[test]
    fn a_mirrored_matrix_has_no_rotation() {
        let turn = Rotation3::from_euler_angles(0.1, -0.2, 0.3);
        let symmetric = symmetric_matrix(&Vector3::new(1.1, 0.9, 1.0), &Vector3::new(0.1, 0.0, -0.05));
        let (rotation, remainder) = polar_decomposition(&(turn.matrix() * symmetric)).unwrap();
        assert!(
            (rotation - turn.matrix()).norm() < 1e-9 && (remainder - symmetric).norm() < 1e-9,
            "{rotation} {remainder}"
        );
        assert!(polar_decomposition(&-symmetric).is_none());
    }

    /// A rotation of the field by 3 deg to the right lowers all headings by 3 deg. Hard iron `b` bends level headings by
    /// `b / H sin(heading)`, RMS `b / H / sqrt 2`.
    #[test]
    fn the_heading_loss_is_an_rms_about_a_mean() {
        let mut rows: Vec<ReplayRow> = (0..36).map(|i| level_row(f64::from(i), f64::from(i) * 10.0)).collect();
        rows.push(ReplayRow { is_usable: false, raw_field: Field::from_ut(-9.0, 30.0, 0.0), ..rows[3] });
        let rotated = FieldCorrection {
            matrix: Rotation3::from_axis_angle(&Vector3::z_axis(), f64::to_radians(3.0)).into_inner(),
            hard_iron_ut: Vector3::new(0.25, 0.0, 0.0),
            ..FieldCorrection::identity()
        };
        let [rms_deg, mean_deg] = heading_loss_deg_of(&rows, &rows, &FieldCorrection::identity(), &rotated);
        let expected_rms_deg = (0.25 / LEVEL_ROW_FIELD_UT[0] / 2_f64.sqrt()).to_degrees();
        assert!((rms_deg / expected_rms_deg - 1.0).abs() < 0.01, "{rms_deg} {expected_rms_deg}");
        assert!((mean_deg + 3.0).abs() < 0.01, "{mean_deg}");
    }
}
