//! Units that the header of a table declares: `mx (uT)`, `roll [rad]`, `time_ms`.

/// Quantity of a column, with the unit of the reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    /// Seconds.
    Time,
    /// Microtesla.
    Field,
    /// Degrees.
    Angle,
    /// Degrees per second.
    Rate,
    /// Meters per second squared.
    Force,
}

/// Quantities of the columns, and names before a unit as in `roll_rad`.
const COLUMN_QUANTITIES: [(&str, Quantity, &[&str]); 14] = [
    ("t_s", Quantity::Time, &["t", "time"]),
    ("mx", Quantity::Field, &["mx", "magx", "mag_x"]),
    ("my", Quantity::Field, &["my", "magy", "mag_y"]),
    ("mz", Quantity::Field, &["mz", "magz", "mag_z"]),
    ("roll_deg", Quantity::Angle, &["roll"]),
    ("pitch_deg", Quantity::Angle, &["pitch"]),
    ("yaw_ref_deg", Quantity::Angle, &["yaw_ref"]),
    ("yaw_deg", Quantity::Angle, &["yaw"]),
    ("p_dps", Quantity::Rate, &["p"]),
    ("q_dps", Quantity::Rate, &["q"]),
    ("r_dps", Quantity::Rate, &["r"]),
    ("ax", Quantity::Force, &["ax"]),
    ("ay", Quantity::Force, &["ay"]),
    ("az", Quantity::Force, &["az"]),
];

/// Names of the units in lower case, and their sizes in that of the reader.
const UNITS: [(Quantity, &[&str], f64); 19] = [
    (Quantity::Time, &["s", "sec", "seconds"], 1.0),
    (Quantity::Time, &["ms", "millis", "milliseconds"], 1e-3),
    (Quantity::Time, &["us", "\u{b5}s", "\u{3bc}s", "micros", "microseconds"], 1e-6),
    (Quantity::Time, &["ns", "nanoseconds"], 1e-9),
    (Quantity::Field, &["mg", "mgauss", "milligauss"], 0.1),
    (Quantity::Field, &["g", "ga", "gauss"], 100.0),
    (Quantity::Field, &["ut", "\u{b5}t", "\u{3bc}t", "microtesla"], 1.0),
    (Quantity::Field, &["nt", "nanotesla"], 1e-3),
    (Quantity::Field, &["mt", "millitesla"], 1e3),
    (Quantity::Field, &["t", "tesla"], 1e6),
    // x-IMU3: 1 is the strength where it was calibrated, 50 uT to a third.
    (Quantity::Field, &["a.u."], 50.0),
    (Quantity::Angle, &["deg", "degrees", "\u{b0}"], 1.0),
    (Quantity::Angle, &["rad", "radians"], 180.0 / std::f64::consts::PI),
    (Quantity::Angle, &["cdeg", "centideg", "centidegrees"], 0.01),
    (Quantity::Rate, &["dps", "deg/s", "deg_s", "\u{b0}/s"], 1.0),
    (Quantity::Rate, &["rad/s", "rad_s", "radps"], 180.0 / std::f64::consts::PI),
    (Quantity::Rate, &["mdps"], 1e-3),
    (Quantity::Force, &["m/s2", "m/s^2", "m/s\u{b2}", "mps2", "m_s2"], 1.0),
    (Quantity::Force, &["g"], 9.806_65),
];

/// Names of the columns whose units a header may declare.
pub(super) fn columns_with_units() -> impl Iterator<Item = &'static str> {
    COLUMN_QUANTITIES.iter().map(|(name, ..)| *name)
}

/// Splits a header's cell into name and declared unit.
pub(super) fn name_and_unit(cell: &str) -> (&str, Option<&str>) {
    match cell.split_once(['(', '[']) {
        Some((name, unit)) => (name.trim(), Some(unit.trim_end_matches([')', ']']).trim())),
        None => (cell, None),
    }
}

/// Size of a column's declared unit in that of the reader.
///
/// # Errors
///
/// The unit is unknown, or belongs to another quantity.
pub(super) fn unit_size(column: &str, unit: &str) -> Result<f64, ()> {
    let base = column.trim_end_matches(|character: char| character.is_ascii_digit());
    let Some((_, quantity, _)) = COLUMN_QUANTITIES.iter().find(|(name, ..)| *name == base) else { return Ok(1.0) };
    size_of(*quantity, unit).ok_or(())
}

/// Index of a cell that names a column with a unit, as `roll_rad`, and the unit's size.
pub(super) fn find_with_unit(names: &[&str], column: &str) -> Option<(usize, f64)> {
    let (_, quantity, bases) = COLUMN_QUANTITIES.iter().find(|(name, ..)| *name == column)?;
    names.iter().enumerate().find_map(|(index, name)| {
        let name = name.to_lowercase();
        let unit = bases.iter().find_map(|base| name.strip_prefix(base)?.strip_prefix('_').map(str::to_owned))?;
        Some((index, size_of(*quantity, &unit)?))
    })
}

fn size_of(quantity: Quantity, unit: &str) -> Option<f64> {
    let unit = unit.to_lowercase();
    let is_unit = |&&(of, names, _): &&(Quantity, &[&str], f64)| of == quantity && names.contains(&unit.as_str());
    UNITS.iter().find(is_unit).map(|(.., size)| *size)
}
