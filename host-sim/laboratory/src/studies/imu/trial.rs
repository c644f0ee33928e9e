//! Recorded trial of an inertial sensor with optical truth.

use autoswing::frames::{Field, Sensor};
use autoswing::inertial::InertialSample;
use nalgebra::{UnitQuaternion, Vector3};

/// Columns of a table; others are ignored.
const COLUMNS: [&str; 14] = [
    "t_s",
    "p_dps",
    "q_dps",
    "r_dps",
    "ax_mps2",
    "ay_mps2",
    "az_mps2",
    "mx_ut",
    "my_ut",
    "mz_ut",
    "roll_ref_deg",
    "pitch_ref_deg",
    "yaw_ref_deg",
    "moving",
];

/// Row of a trial.
#[derive(Clone, Debug)]
pub struct TrialRow {
    /// Time, seconds.
    pub t_s: f64,
    /// Gyro and accelerometer.
    pub inertial: InertialSample,
    /// Magnetometer, body axes.
    pub field: Field<Sensor>,
    /// True rotation from body to reference frame; `None` where the camera lost the sensor.
    pub truth: Option<UnitQuaternion<f64>>,
    /// Whether the row counts for the score.
    pub is_scored: bool,
}

/// Reads a comma-separated table with the column names in its first line.
///
/// # Errors
///
/// A column is missing, a line has no number for a sensor, or the times do not increase.
pub fn read_trial(text: &str) -> Result<Vec<TrialRow>, String> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let mut positions = [0; COLUMNS.len()];
    for (position, column) in positions.iter_mut().zip(COLUMNS) {
        *position = names.iter().position(|name| *name == column).ok_or_else(|| format!("no column {column}"))?;
    }
    let mut rows: Vec<TrialRow> = Vec::new();
    for (line_number, line) in (2..).zip(lines) {
        let cells: Vec<&str> = line.split(',').collect();
        let numbers = positions.map(|position| cells.get(position).and_then(|cell| cell.trim().parse().ok()));
        let row = trial_row(&numbers).ok_or_else(|| format!("line {line_number}: a number is missing"))?;
        if rows.last().is_some_and(|last| last.t_s >= row.t_s) {
            return Err(format!("line {line_number}: the time does not increase"));
        }
        rows.push(row);
    }
    Ok(rows)
}

/// The row of a line's numbers, in the order of [`COLUMNS`]; `None` if one is missing that must not.
fn trial_row(numbers: &[Option<f64>; COLUMNS.len()]) -> Option<TrialRow> {
    let vector = |first: usize| Some(Vector3::new(numbers[first]?, numbers[first + 1]?, numbers[first + 2]?));
    let angles_rad = vector(10).map(|angles_deg| angles_deg.map(f64::to_radians));
    Some(TrialRow {
        t_s: numbers[0].filter(|t_s| t_s.is_finite())?,
        inertial: InertialSample {
            rates_rad_s: vector(1)?.map(f64::to_radians).cast(),
            specific_force_m_s2: vector(4)?.cast(),
        },
        field: Field::new(vector(7)?.cast()),
        truth: angles_rad.map(|angles| UnitQuaternion::from_euler_angles(angles.x, angles.y, angles.z)),
        is_scored: numbers[13]? != 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_their_columns_by_name() {
        let header = "yaw_ref_deg,t_s,p_dps,q_dps,r_dps,ax_mps2,ay_mps2,az_mps2,mx_ut,my_ut,mz_ut,roll_ref_deg,\
                      pitch_ref_deg,extra,moving";
        let text = format!("{header}\n90,0.5,180,0,0,1,2,3,4,5,6,0,0,x,1\n,0.6,0,0,0,1,2,3,4,5,6,,,x,0\n");
        let rows = read_trial(&text).unwrap();
        assert!((rows[0].inertial.rates_rad_s.x - core::f32::consts::PI).abs() < 1e-6);
        assert_eq!((rows[0].field.ut.z, rows[0].inertial.specific_force_m_s2.y), (6.0, 2.0));
        assert!((rows[0].truth.unwrap() * Vector3::x() - Vector3::y()).norm() < 1e-12);
        assert_eq!((rows[0].is_scored, rows[1].is_scored, rows[1].truth), (true, false, None));
        for (bad, error) in [
            (text.replace("mx_ut", "mx"), "no column mx_ut"),
            (text.replace("180", "fast"), "line 2: a number is missing"),
            (text.replace("0.6", "0.5"), "line 3: the time does not increase"),
        ] {
            assert_eq!(read_trial(&bad).unwrap_err(), error);
        }
    }
}
