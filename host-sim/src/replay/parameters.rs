//! Parameters to load: what the module solved, as an autopilot can express it.
//!
//! A solution is `h = W (m - b)` in body axes. An autopilot's matrix is symmetric, so of `W = R S`, a turn after a symmetric
//! matrix (polar decomposition), it can have `S`; `R`, the mounting that is not square, is lost. A turn that is nearer to
//! another right-angle mounting than to none goes into the orientation.

use std::fmt::Write as _;

use autoswing::frames::Field;
use nalgebra::{DMatrix, DVector, Matrix3, SVD, Vector3};

use super::judge::{Judged, scored};
use super::{Row, Score};
use crate::log::{Autopilot, Flight, Iron, Parameters, Rotation, px4_mounting};
use crate::score::wrap_180;

/// Whose parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// `COMPASS_*`, a name and a value a line.
    ArduPilot,
    /// `CAL_MAGn_*`, as QGroundControl loads them.
    Px4,
    /// Lines for its command line.
    Inav,
}

impl Dialect {
    /// That of the autopilot that wrote the log.
    #[must_use]
    pub const fn of(autopilot: Autopilot) -> Self {
        match autopilot {
            Autopilot::Px4 => Self::Px4,
            Autopilot::ArduPilot | Autopilot::Unknown => Self::ArduPilot,
        }
    }
}

/// What an autopilot can have of a solution.
#[derive(Clone, Debug, PartialEq)]
pub struct HandedOver {
    /// The compass, from 1.
    pub number: u8,
    /// As it corrects a field that is turned by `turned`, in body axes, microtesla.
    pub iron: Iron,
    /// How the sensor sits otherwise than the log says, in body axes.
    pub turned: Rotation,
    /// The heading error that it adds, degrees RMS less mean, and its mean.
    pub lost_deg: [f64; 2],
    /// How good its headings are, where there is a reference.
    pub score: Option<Score>,
    /// What cannot be expressed, or will not be taken.
    pub warnings: Vec<String>,
}

/// The largest offset that ArduPilot takes unless `COMPASS_OFFS_MAX` says otherwise, milligauss.
const USUAL_MAX_OFFSET: f64 = 1800.0;

/// What is lost that is worth a warning, degrees.
const LOSS_WORTH_SAYING_DEG: f64 = 0.3;

const MILLIGAUSS: f64 = 10.0;
const GAUSS: f64 = 0.01;
/// PX4 counts in gauss per kiloampere.
const AMPERES_IN_KILOAMPERE: f64 = 1000.0;

impl HandedOver {
    fn goes_with_current(&self) -> bool {
        self.iron.by_current_ut != Vector3::zeros()
    }
}

/// What an autopilot can have of what the module made of a compass; none of one that it would have refused.
/// `total_ut` is the Earth's field there, if it is known.
#[must_use]
pub fn handed_over(flight: &Flight, judged: &Judged, total_ut: Option<f64>, dialect: Dialect) -> Option<HandedOver> {
    let replayed = [&judged.module, &judged.all].into_iter().find(|replayed| replayed.accepted.is_ok())?;
    let calibration = replayed.solution.as_ref()?.calibration;
    let w = calibration.w_matrix().map(f64::from);
    let b = calibration.b_vector_ut().map(f64::from);
    let (turn, symmetric) = polar(&w)?;
    let turned = right_angle(&turn);
    let q = turned.matrix();
    // As strong as the Earth's field is there, or as it came out.
    let scale = total_ut.map_or(1.0, |total_ut| total_ut / f64::from(calibration.total_ut));
    let rows: Vec<Row> = judged.rows.iter().map(|row| turned_row(row, &q)).collect();
    let by_current_ut = Vector3::from(calibration.current.ut_per_a).map(f64::from);
    let full = Iron { matrix: w, centre_ut: b, by_current_ut };
    // INAV knows no current: what the mean of it adds is there at all times.
    let usual_a = if dialect == Dialect::Inav { f64::from(calibration.current.mean_a) } else { 0.0 };
    let near = Iron {
        matrix: q * symmetric * q.transpose() * scale,
        centre_ut: q * (b + by_current_ut * usual_a),
        by_current_ut: if dialect == Dialect::Inav { Vector3::zeros() } else { q * by_current_ut },
    };
    let iron = nearest(&judged.rows, &rows, &full, near, dialect == Dialect::Inav);
    let lost_deg = lost(&judged.rows, &rows, &full, &iron);
    let mut warnings = Vec::new();
    if lost_deg[0] > LOSS_WORTH_SAYING_DEG {
        warnings.push(format!("what cannot be expressed costs {:.1} deg RMS", lost_deg[0]));
    }
    if dialect == Dialect::Inav && calibration.current.is_used() {
        warnings.push("what goes with the current cannot be expressed".to_owned());
    }
    if turned.number() != 0 {
        warnings.push("the compass sits otherwise than the parameters said: check the orientation".to_owned());
    }
    let most = flight.parameters.last("COMPASS_OFFS_MAX").unwrap_or(USUAL_MAX_OFFSET);
    if dialect == Dialect::ArduPilot && iron.centre_ut.amax() * MILLIGAUSS > most {
        warnings.push(format!("offsets beyond COMPASS_OFFS_MAX, {most:.0}, are not taken"));
    }
    Some(HandedOver { number: judged.number, iron, turned, lost_deg, score: scored(&rows, &iron), warnings })
}

/// The symmetric (or diagonal) matrix and the centre whose headings are nearest to those of a full correction over the rows
/// that count, by least squares from what is near already (Gauss-Newton). The size of the field is kept.
fn nearest(rows: &[Row], turned: &[Row], full: &Iron, near: Iron, is_diagonal: bool) -> Iron {
    const STEPS: usize = 6;
    const MAX_ROWS: usize = 1000;
    /// What rows do not tell stays where it is: how far an element of the matrix and, microtesla, the centre may go for an
    /// error of a degree in one row.
    const SPARE: [f64; 2] = [0.3, 30.0];
    let every = rows.iter().filter(|row| row.usable).count().div_ceil(MAX_ROWS).max(1);
    let pairs: Vec<(&Row, f64)> = rows
        .iter()
        .zip(turned)
        .filter(|(row, _)| row.usable)
        .step_by(every)
        .map(|(row, turned)| (turned, heading_deg(row, full)))
        .collect();
    let number = if is_diagonal { 6 } else { 9 };
    let built = |p: &DVector<f64>| {
        let off = if is_diagonal { Vector3::zeros() } else { Vector3::new(p[6], p[7], p[8]) };
        let matrix = symmetric_of(&Vector3::new(p[0], p[1], p[2]), &off);
        Iron { matrix, centre_ut: Vector3::new(p[3], p[4], p[5]), ..near }
    };
    let [centre, diagonal, off] = parts(&near);
    let start =
        DVector::from_iterator(number, diagonal.iter().chain(centre.iter()).chain(off.iter()).copied().take(number));
    let residuals = |p: &DVector<f64>| {
        let iron = built(p);
        DVector::from_iterator(pairs.len(), pairs.iter().map(|(row, told)| wrap_180(heading_deg(row, &iron) - told)))
    };
    let mut best = (start.clone(), residuals(&start).norm_squared());
    for _ in 0..STEPS {
        let from = residuals(&best.0);
        let mut by = DMatrix::zeros(pairs.len(), number);
        for i in 0..number {
            let step = if (3..6).contains(&i) { 0.01 } else { 1e-4 };
            let mut moved = best.0.clone();
            moved[i] += step;
            by.set_column(i, &((residuals(&moved) - &from).map(wrap_180) / step));
        }
        let mut normal = by.transpose() * &by;
        let mut side = -(by.transpose() * from);
        for i in 0..number {
            let weight = SPARE[usize::from((3..6).contains(&i))].powi(-2);
            normal[(i, i)] += weight;
            side[i] += weight * (start[i] - best.0[i]);
        }
        let Some(cholesky) = normal.cholesky() else { break };
        let tried = &best.0 + cholesky.solve(&side);
        let squares = residuals(&tried).norm_squared();
        if squares >= best.1 {
            break;
        }
        best = (tried, squares);
    }
    let found = built(&best.0);
    // Headings do not tell the size: that of what was near is kept.
    let total = |iron: &Iron| -> f64 { pairs.iter().map(|(row, _)| row.corrected(iron).norm()).sum() };
    let size = total(&near) / total(&found);
    if size.is_finite() && size > 0.0 { Iron { matrix: found.matrix * size, ..found } } else { near }
}

fn symmetric_of(d: &Vector3<f64>, o: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z)
}

fn heading_deg(row: &Row, iron: &Iron) -> f64 {
    let corrected = row.corrected(iron).map(|axis| axis as f32);
    f64::from(row.attitude.level(Field::new(corrected)).heading_rad().to_degrees())
}

/// A turn and a symmetric matrix whose product a matrix is.
fn polar(matrix: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let SVD { u, v_t, singular_values } = SVD::new(*matrix, true, true);
    let (u, v_t) = (u?, v_t?);
    let turn = u * v_t;
    let symmetric = v_t.transpose() * Matrix3::from_diagonal(&singular_values) * v_t;
    (turn.determinant() > 0.0).then_some((turn, symmetric))
}

/// The right-angle mounting nearest to a turn: none, unless another is much nearer.
fn right_angle(turn: &Matrix3<f64>) -> Rotation {
    let (nearest, off_deg) = Rotation::nearest(turn);
    let is_square = nearest.matrix().iter().all(|number| (number.abs() - 0.5).abs() > 0.49);
    if is_square && off_deg < 25.0 { nearest } else { Rotation::default() }
}

fn turned_row(row: &Row, q: &Matrix3<f64>) -> Row {
    let field = q * row.field.ut.map(f64::from);
    Row { field: Field::new(field.map(|axis| axis as f32)), ..*row }
}

/// How headings by two corrections differ over the rows that count, degrees: RMS less mean, and mean.
fn lost(rows: &[Row], turned: &[Row], full: &Iron, other: &Iron) -> [f64; 2] {
    let differences: Vec<f64> = rows
        .iter()
        .zip(turned)
        .filter(|(row, _)| row.usable)
        .map(|(row, turned)| wrap_180(heading_deg(turned, other) - heading_deg(row, full)))
        .collect();
    let number = differences.len().max(1) as f64;
    let mean = differences.iter().sum::<f64>() / number;
    let squares = differences.iter().map(|difference| (difference - mean).powi(2)).sum::<f64>();
    [(squares / number).sqrt(), mean]
}

/// The file.
#[must_use]
pub fn file(flight: &Flight, handed_over: &[HandedOver], dialect: Dialect) -> String {
    let mut text = String::new();
    // Writing to a string never fails.
    let _ = match dialect {
        Dialect::ArduPilot => ardupilot(&mut text, flight, handed_over),
        Dialect::Px4 => px4(&mut text, flight, handed_over),
        Dialect::Inav => inav(&mut text, handed_over),
    };
    text
}

fn comments(text: &mut String, handed: &HandedOver) -> std::fmt::Result {
    writeln!(
        text,
        "# compass {}; {:.2} deg RMS are lost by what cannot be expressed",
        handed.number, handed.lost_deg[0]
    )?;
    handed.warnings.iter().try_for_each(|warning| writeln!(text, "# {warning}"))
}

fn ardupilot(text: &mut String, flight: &Flight, handed_over: &[HandedOver]) -> std::fmt::Result {
    if handed_over.iter().any(HandedOver::goes_with_current) {
        writeln!(text, "COMPASS_MOTCT,2")?;
    }
    for handed in handed_over {
        comments(text, handed)?;
        let index = if handed.number == 1 { String::new() } else { handed.number.to_string() };
        let [offsets, diagonal, off_diagonal] = parts(&handed.iron);
        for (name, numbers, decimals) in [
            ("OFS", -offsets * MILLIGAUSS, 2),
            ("DIA", diagonal, 5),
            ("ODI", off_diagonal, 5),
            // Added after the matrix: it takes away there what the current had added before.
            ("MOT", -(handed.iron.matrix * handed.iron.by_current_ut) * MILLIGAUSS, 3),
        ] {
            for (axis, number) in ["X", "Y", "Z"].iter().zip(numbers.iter()) {
                writeln!(text, "COMPASS_{name}{index}_{axis},{number:.decimals$}")?;
            }
        }
        writeln!(text, "COMPASS_SCALE{index},1")?;
        let orient = format!("COMPASS_ORIENT{index}");
        if let Some(now) = flight.parameters.last(&orient) {
            let external =
                if handed.number == 1 { "COMPASS_EXTERNAL".to_owned() } else { format!("COMPASS_EXTERN{index}") };
            let is_internal = flight.parameters.last(&external) == Some(0.0);
            let combined = Rotation::new(now).map(|now| Rotation::nearest(&(handed.turned.matrix() * now.matrix())));
            match combined {
                _ if handed.turned.number() == 0 => writeln!(text, "{orient},{now:.0}")?,
                // The autopilot turns such a one by AHRS_ORIENTATION.
                _ if is_internal => writeln!(text, "# {orient}: {external} is 0, so it is not asked for how it sits")?,
                Some((rotation, off_deg)) if off_deg < 1.0 => writeln!(text, "{orient},{}", rotation.number())?,
                _ => writeln!(text, "# {orient}: no number for how it sits")?,
            }
        }
    }
    Ok(())
}

/// Vehicle, component, name, value, type (9 float, 6 integer), tab-separated.
fn px4(text: &mut String, flight: &Flight, handed_over: &[HandedOver]) -> std::fmt::Result {
    if handed_over.iter().any(HandedOver::goes_with_current) {
        // Current of the first battery.
        writeln!(text, "1\t1\tCAL_MAG_COMP_TYP\t2\t6")?;
    }
    for handed in handed_over {
        comments(text, handed)?;
        let index = handed.number - 1;
        let own = flight.parameters.last(&format!("CAL_MAG{index}_ROT")).filter(|number| *number >= 0.0);
        let mounting = handed.turned.matrix() * px4_mounting(&flight.parameters, f64::INFINITY, index);
        let (combined, off_deg) = Rotation::nearest(&mounting);
        let to_sensor = mounting.transpose();
        let sensor = Iron {
            matrix: to_sensor * handed.iron.matrix * to_sensor.transpose(),
            centre_ut: to_sensor * handed.iron.centre_ut,
            by_current_ut: to_sensor * handed.iron.by_current_ut,
        };
        let [offsets, diagonal, off_diagonal] = parts(&sensor);
        let comp = -sensor.by_current_ut * GAUSS * AMPERES_IN_KILOAMPERE;
        for (name, numbers) in [("OFF", offsets * GAUSS), ("SCALE", diagonal), ("ODIAG", off_diagonal), ("COMP", comp)]
        {
            for (axis, number) in ["X", "Y", "Z"].iter().zip(numbers.iter()) {
                writeln!(text, "1\t1\tCAL_MAG{index}_{axis}{name}\t{number:.6}\t9")?;
            }
        }
        match own {
            // One in angles of its own stays as it is.
            Some(number) if off_deg < 1.0 && Rotation::new(number).is_some() => {
                writeln!(text, "1\t1\tCAL_MAG{index}_ROT\t{}\t6", combined.number())?;
            }
            _ if handed.turned.number() != 0 => {
                writeln!(text, "# CAL_MAG{index}_ROT: it sits otherwise than its board")?;
            }
            _ => {}
        }
    }
    Ok(())
}

/// INAV takes zeros and gains in the counts of its driver and the axes of the chip, which no log tells: these are milligauss
/// in body axes, for a sensor that is mounted straight.
fn inav(text: &mut String, handed_over: &[HandedOver]) -> std::fmt::Result {
    for handed in handed_over.iter().take(1) {
        comments(text, handed)?;
        writeln!(text, "# milligauss, in body axes: for a driver that counts milligauss, and align_mag that is right")?;
        for (axis, (zero, gain)) in
            ["x", "y", "z"].iter().zip(handed.iron.centre_ut.iter().zip(handed.iron.matrix.diagonal().iter()))
        {
            writeln!(text, "set magzero_{axis} = {:.0}", zero * MILLIGAUSS)?;
            writeln!(text, "set maggain_{axis} = {:.0}", 1024.0 / gain)?;
        }
        writeln!(text, "save")?;
    }
    Ok(())
}

/// Centre, diagonal, and what stands at xy, xz and yz.
fn parts(iron: &Iron) -> [Vector3<f64>; 3] {
    let m = &iron.matrix;
    [iron.centre_ut, m.diagonal(), Vector3::new(m[(0, 1)], m[(0, 2)], m[(1, 2)])]
}

/// The parameters of a file that [`file()`] wrote, for a flight whose other parameters are these.
#[must_use]
pub fn read_back(text: &str, others: &Parameters) -> Parameters {
    let mut parameters = others.clone();
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split([',', '\t']).collect();
        let ([name, value] | [_, _, name, value, _]) = *words.as_slice() else { continue };
        if let Ok(value) = value.parse() {
            parameters.set(f64::MAX, name, value);
        }
    }
    parameters
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// A mounting that is less than 25 deg from square is crooked; one midway is anybody's guess, and stays as the log has it.
    #[test]
    fn a_mounting_is_the_right_angle_that_it_is_near() {
        for (yaw_deg, number) in
            [(0.0, 0), (20.0, 0), (35.0, 0), (45.0, 0), (60.0, 0), (70.0, 2), (90.0, 2), (180.0, 4)]
        {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), f64::to_radians(yaw_deg));
            assert_eq!(right_angle(turn.matrix()).number(), number, "{yaw_deg}");
        }
        // Crooked about an axis on which no mounting of half a right angle lies.
        let diagonal = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
        for (off_deg, number) in [(24.0, 2), (26.0, 0)] {
            let crooked = Rotation3::from_axis_angle(&diagonal, f64::to_radians(off_deg));
            let square = Rotation::new(2.0).unwrap().matrix();
            assert_eq!(right_angle(&(square * crooked.matrix())).number(), number, "{off_deg}");
        }
    }

    #[test]
    fn a_mirrored_sensor_is_no_turn() {
        let turn = Rotation3::from_euler_angles(0.1, -0.2, 0.3);
        let symmetric = symmetric_of(&Vector3::new(1.1, 0.9, 1.0), &Vector3::new(0.1, 0.0, -0.05));
        let (found, rest) = polar(&(turn.matrix() * symmetric)).unwrap();
        assert!((found - turn.matrix()).norm() < 1e-9 && (rest - symmetric).norm() < 1e-9, "{found} {rest}");
        assert!(polar(&-symmetric).is_none());
    }
}
