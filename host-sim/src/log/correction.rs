//! What an autopilot made of the field before it logged it, and how that is undone.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::flight::{Autopilot, Flight};
use super::parameters::Parameters;
use super::rotation::Rotation;

/// Microtesla in a milligauss and in a gauss.
const MILLIGAUSS_UT: f64 = 0.1;
const GAUSS_UT: f64 = 100.0;

/// A correction for iron in body axes: `corrected = matrix (raw - centre - by_current I)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iron {
    /// Soft iron and scale.
    pub matrix: Matrix3<f64>,
    /// Hard iron, microtesla.
    pub centre_ut: Vector3<f64>,
    /// What each ampere of the current `I` adds to the raw field, microtesla.
    pub by_current_ut: Vector3<f64>,
}

impl Iron {
    /// No correction.
    #[must_use]
    pub fn none() -> Self {
        Self::constant(Matrix3::identity(), Vector3::zeros())
    }

    /// One that no current changes.
    #[must_use]
    pub fn constant(matrix: Matrix3<f64>, centre_ut: Vector3<f64>) -> Self {
        Self { matrix, centre_ut, by_current_ut: Vector3::zeros() }
    }

    /// The corrected field of a raw one, measured at a current, amperes.
    #[must_use]
    pub fn apply(&self, raw_ut: Vector3<f64>, current_a: f64) -> Vector3<f64> {
        self.matrix * (raw_ut - self.centre_ut - self.by_current_ut * current_a)
    }

    /// What ArduPilot corrects a compass with, by its last parameters; what it adds by the throttle is not in it.
    #[must_use]
    pub fn of_ardupilot(parameters: &Parameters, number: u8) -> Self {
        Undo::ardupilot(parameters, f64::INFINITY, number).iron
    }

    /// What PX4 corrects a compass with, by its last parameters.
    #[must_use]
    pub fn of_px4(parameters: &Parameters, number: u8) -> Self {
        Undo::px4(parameters, f64::INFINITY, number.saturating_sub(1)).iron
    }
}

/// How to get from what is logged to the raw field, at the parameters of some time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Undo {
    pub iron: Iron,
    inverse: Matrix3<f64>,
}

impl Undo {
    /// The raw field of a logged one, `motor_ut` of it being what was added for the motors.
    pub fn raw(&self, logged_ut: Vector3<f64>, motor_ut: Vector3<f64>) -> Vector3<f64> {
        self.inverse * (logged_ut - motor_ut) + self.iron.centre_ut
    }

    /// The share of a logged field that was added for the motors at a current, amperes, microtesla.
    pub fn motor_ut(&self, current_a: f64) -> Vector3<f64> {
        self.iron.matrix * self.iron.by_current_ut * -current_a
    }

    /// Of a correction, after which so many microtesla are added for each ampere.
    fn of(iron: Iron, after_ut: Vector3<f64>) -> Self {
        match iron.matrix.try_inverse() {
            Some(inverse) if inverse.iter().all(|number| number.is_finite()) => {
                let by_current_ut = iron.by_current_ut - inverse * after_ut;
                Self { iron: Iron { by_current_ut, ..iron }, inverse }
            }
            // Nobody flies with that: what is logged is taken as it stands.
            _ => Self { iron: Iron::none(), inverse: Matrix3::identity() },
        }
    }

    /// ArduPilot's, by its parameters of that time: `f = M ((raw + OFS) SCALE)`, then the motors' share (AP_Compass,
    /// `AP_Compass_Backend::correct_field`). A scale outside of 1/1.5 to 1.5 and diagonals of nothing mean one.
    pub fn ardupilot(parameters: &Parameters, t_s: f64, number: u8) -> Self {
        let index = if number == 1 { String::new() } else { number.to_string() };
        let value = |name: &str| parameters.at(t_s, name);
        let vector = |what: &str| {
            let [x, y, z] = ["X", "Y", "Z"].map(|axis| value(&format!("COMPASS_{what}{index}_{axis}")).unwrap_or(0.0));
            Vector3::new(x, y, z)
        };
        let scale =
            value(&format!("COMPASS_SCALE{index}")).filter(|scale| (1.0 / 1.5..=1.5).contains(scale)).unwrap_or(1.0);
        let off_diagonal = vector("ODI");
        let diagonal = ["X", "Y", "Z"].map(|axis| value(&format!("COMPASS_DIA{index}_{axis}")));
        let soft = if diagonal.iter().flatten().all(|axis| *axis == 0.0) {
            Matrix3::identity()
        } else {
            // A link loses one of three: what it would be if nobody had set it.
            symmetric(&Vector3::from(diagonal.map(|axis| axis.unwrap_or(1.0))), &off_diagonal)
        };
        let is_by_current = value("COMPASS_MOTCT").is_some_and(|kind| kind.round() as i32 == 2);
        let after_ut = if is_by_current { vector("MOT") * MILLIGAUSS_UT } else { Vector3::zeros() };
        Self::of(Iron::constant(soft * scale, -vector("OFS") * MILLIGAUSS_UT), after_ut)
    }

    /// PX4's, by its parameters: in the sensor's axes `scale (raw + current COMP - offset)`, then turned into the body's
    /// (`calibration::Magnetometer::Correct`); `COMP` is in gauss per kiloampere, and of a battery where `CAL_MAG_COMP_TYP`
    /// is 2 or 3. `index` is that of `CAL_MAGn`.
    pub fn px4(parameters: &Parameters, t_s: f64, index: u8) -> Self {
        let value = |name: &str| parameters.at(t_s, &format!("CAL_MAG{index}_{name}"));
        let vector = |what: &str, none: f64| {
            let [x, y, z] = ["X", "Y", "Z"].map(|axis| value(&format!("{axis}{what}")).unwrap_or(none));
            Vector3::new(x, y, z)
        };
        let mut diagonal = vector("SCALE", 1.0);
        if diagonal.iter().any(|scale| *scale < 1e-3) {
            diagonal = Vector3::repeat(1.0);
        }
        let turned = px4_mounting(parameters, t_s, index);
        let scale = turned * symmetric(&diagonal, &vector("ODIAG", 0.0)) * turned.transpose();
        let is_by_current =
            parameters.at(t_s, "CAL_MAG_COMP_TYP").is_some_and(|kind| [2, 3].contains(&(kind.round() as i32)));
        let comp = if is_by_current { vector("COMP", 0.0) } else { Vector3::zeros() };
        let by_current_ut = turned * comp * -GAUSS_UT / 1000.0;
        let iron = Iron { by_current_ut, ..Iron::constant(scale, turned * vector("OFF", 0.0) * GAUSS_UT) };
        Self::of(iron, Vector3::zeros())
    }
}

/// The parameters of a compass of ArduPilot's that are not there though others of the same three are.
#[must_use]
pub fn missing_of_ardupilot(parameters: &Parameters, number: u8) -> Vec<String> {
    let index = if number == 1 { String::new() } else { number.to_string() };
    let mut missing = Vec::new();
    for what in ["OFS", "DIA", "ODI"] {
        let names = ["X", "Y", "Z"].map(|axis| format!("COMPASS_{what}{index}_{axis}"));
        let (known, unknown): (Vec<_>, Vec<_>) = names.into_iter().partition(|name| parameters.last(name).is_some());
        if !known.is_empty() {
            missing.extend(unknown);
        }
    }
    missing
}

/// The parameters by which a compass or the board is turned that changed in the log, each with the instant of its last change,
/// seconds.
#[must_use]
pub fn turned_in_flight(flight: &Flight, number: u8) -> Vec<(String, f64)> {
    let index = if number == 1 { String::new() } else { number.to_string() };
    let external = if number == 1 { "COMPASS_EXTERNAL".to_owned() } else { format!("COMPASS_EXTERN{number}") };
    let names = match flight.autopilot {
        Autopilot::ArduPilot => vec![format!("COMPASS_ORIENT{index}"), external, "AHRS_ORIENTATION".to_owned()],
        Autopilot::Px4 => vec![format!("CAL_MAG{}_ROT", number.saturating_sub(1)), "SENS_BOARD_ROT".to_owned()],
        Autopilot::Unknown => Vec::new(),
    };
    let changed = |name: String| flight.parameters.changed_s(&name).map(|at_s| (name, at_s));
    names.into_iter().filter_map(changed).collect()
}

/// How a compass of PX4 sits, from the sensor's axes to the body's: as its own parameter says, in angles of its own where that
/// is 100; or, if it is negative, as the board does, which is trimmed by `SENS_BOARD_X_OFF`, `_Y_OFF` and `_Z_OFF`.
pub(crate) fn px4_mounting(parameters: &Parameters, t_s: f64, index: u8) -> Matrix3<f64> {
    const CUSTOM: f64 = 100.0;
    let value = |name: &str| parameters.at(t_s, name);
    let turned = |names: [String; 3]| {
        let [roll, pitch, yaw] = names.map(|name| value(&name).unwrap_or(0.0).to_radians());
        Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
    };
    let numbered = |number: f64| Rotation::new(number).unwrap_or_default().matrix();
    match value(&format!("CAL_MAG{index}_ROT")).filter(|number| *number >= 0.0) {
        Some(CUSTOM) => turned(["ROLL", "PITCH", "YAW"].map(|angle| format!("CAL_MAG{index}_{angle}"))),
        Some(number) => numbered(number),
        None => {
            let board = value("SENS_BOARD_ROT").map_or_else(Matrix3::identity, numbered);
            turned(["X", "Y", "Z"].map(|axis| format!("SENS_BOARD_{axis}_OFF"))) * board
        }
    }
}

/// A symmetric matrix by its diagonal and by what stands at xy, xz and yz.
pub(crate) fn symmetric(diagonal: &Vector3<f64>, off_diagonal: &Vector3<f64>) -> Matrix3<f64> {
    let (d, o) = (diagonal, off_diagonal);
    Matrix3::new(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(of: &[(&str, f64)]) -> Parameters {
        let mut parameters = Parameters::default();
        for &(name, value) in of {
            parameters.set(0.0, name, value);
        }
        parameters
    }

    /// By hand: what ArduPilot would make of a raw field, and back.
    #[test]
    fn ardupilots_correction_is_undone() {
        let parameters = parameters(&[
            ("COMPASS_OFS2_X", 100.0),
            ("COMPASS_OFS2_Y", -50.0),
            ("COMPASS_DIA2_X", 1.1),
            ("COMPASS_DIA2_Y", 0.9),
            ("COMPASS_DIA2_Z", 1.2),
            ("COMPASS_ODI2_X", 0.05),
            ("COMPASS_ODI2_Z", -0.1),
            ("COMPASS_SCALE2", 1.25),
            ("COMPASS_MOTCT", 2.0),
            ("COMPASS_MOT2_Y", 2.0),
        ]);
        let undo = Undo::ardupilot(&parameters, 0.0, 2);
        // (raw + OFS) SCALE of the raw field 100, 130, -400 mG: 250, 100, -500.
        let logged = Vector3::new(275.0 + 5.0, 12.5 + 90.0 + 50.0, -10.0 - 600.0) * 0.1;
        assert!((undo.raw(logged, Vector3::zeros()) - Vector3::new(10.0, 13.0, -40.0)).norm() < 1e-9);
        assert!((undo.iron.apply(Vector3::new(10.0, 13.0, -40.0), 0.0) - logged).norm() < 1e-9);
        let motor = undo.motor_ut(1.0) * 10.0;
        assert!((motor - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-9);
        assert!((undo.raw(logged + motor, motor) - Vector3::new(10.0, 13.0, -40.0)).norm() < 1e-9);
    }

    /// By hand: PX4's, whose share by current is taken off in the sensor's axes, before the offsets, by kiloampere; and only
    /// where it is by a battery's current.
    #[test]
    fn px4s_correction_for_the_current_is_undone() {
        for (kind, share) in [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (3.0, 1.0)] {
            let undo = Undo::px4(
                &parameters(&[
                    ("CAL_MAG0_XOFF", 0.1),
                    ("CAL_MAG0_YSCALE", 1.1),
                    ("CAL_MAG0_YCOMP", -5.0),
                    // Sensor's z is the body's z, x and y the other way round.
                    ("CAL_MAG0_ROT", 4.0),
                    ("CAL_MAG_COMP_TYP", kind),
                ]),
                0.0,
                0,
            );
            // Body axes, microtesla, at 20 A: 5 G/kA are 0.5 uT per ampere, so 10 on y of the sensor.
            let raw = Vector3::new(20.0, 30.0, 40.0);
            let logged = Vector3::new(20.0 + 10.0, 1.1 * (30.0 + share * 10.0), 40.0);
            assert!((undo.iron.apply(raw, 20.0) - logged).norm() < 1e-9, "{kind}: {}", undo.iron.apply(raw, 20.0));
            assert!((undo.raw(logged, undo.motor_ut(20.0)) - raw).norm() < 1e-9, "{kind}");
        }
    }

    /// A parameter that a link lost is what it would be if nobody had set it, and is named; of a compass that has none nothing
    /// is missed.
    #[test]
    fn a_parameter_that_is_missing_has_its_default() {
        let told = [("COMPASS_OFS_X", 10.0), ("COMPASS_DIA_X", 1.1), ("COMPASS_DIA_Z", 0.9), ("COMPASS_ODI_X", 0.05)];
        let iron = Undo::ardupilot(&parameters(&told), 0.0, 1).iron;
        let expected = Matrix3::new(1.1, 0.05, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0, 0.9);
        assert!((iron.matrix - expected).norm() < 1e-9, "{}", iron.matrix);
        let missing = missing_of_ardupilot(&parameters(&told), 1);
        assert_eq!(missing, ["COMPASS_OFS_Y", "COMPASS_OFS_Z", "COMPASS_DIA_Y", "COMPASS_ODI_Y", "COMPASS_ODI_Z"]);
        assert!(missing_of_ardupilot(&parameters(&told), 2).is_empty());
        // An inverse of almost nothing is none: what is logged would be blown up.
        let singular = parameters(&[("COMPASS_DIA_X", 1.0), ("COMPASS_DIA_Y", 0.0), ("COMPASS_DIA_Z", 1.0)]);
        assert_eq!(Undo::ardupilot(&singular, 0.0, 1).iron, Iron::none());
    }

    #[test]
    fn a_scale_beyond_its_bounds_and_diagonals_of_nothing_mean_one() {
        for (scale, used) in [(1.51, 1.0), (1.5, 1.5), (0.66, 1.0), (0.67, 0.67), (0.0, 1.0)] {
            let undo = Undo::ardupilot(&parameters(&[("COMPASS_SCALE", scale)]), 0.0, 1);
            assert!((undo.iron.matrix - Matrix3::identity() * used).norm() < 1e-9, "{scale}");
        }
        assert_eq!(Undo::ardupilot(&Parameters::default(), 0.0, 1).iron, Iron::none());
        // A matrix without an inverse is no correction.
        let singular = parameters(&[("COMPASS_DIA_X", 1.0)]);
        assert_eq!(Undo::ardupilot(&singular, 0.0, 1).iron, Iron::none());
    }

    /// A text may say any number: what cannot be inverted in a double is no correction, and the field stays one.
    #[test]
    fn a_matrix_beyond_all_numbers_is_no_correction() {
        let told = parameters(
            &["X", "Y", "Z"].map(|axis| format!("COMPASS_DIA_{axis}")).each_ref().map(|name| (name.as_str(), 1e200)),
        );
        let undo = Undo::ardupilot(&told, 0.0, 1);
        assert_eq!(undo.iron, Iron::none());
        let field = Vector3::new(20.0, 0.0, 40.0);
        assert_eq!(undo.raw(field, Vector3::zeros()), field);
    }

    /// An external compass of PX4 that is turned by 90 deg: 0.5 G along the nose are -y of the sensor.
    #[test]
    fn px4s_correction_is_made_in_the_sensors_axes() {
        let parameters = parameters(&[("CAL_MAG1_ROT", 2.0), ("CAL_MAG1_XOFF", 0.1), ("CAL_MAG1_YSCALE", 1.25)]);
        let undo = Undo::px4(&parameters, 0.0, 1);
        // Sensor (0.3, -0.4, 0) G: less offset (0.2, -0.4, 0), scaled (0.2, -0.5, 0), turned (0.5, 0.2, 0).
        let raw = undo.raw(Vector3::new(50.0, 20.0, 0.0), Vector3::zeros());
        assert!((raw - Vector3::new(40.0, 30.0, 0.0)).norm() < 1e-9, "{raw}");
        let board = px4_mounting(&self::parameters(&[("CAL_MAG1_ROT", -1.0), ("SENS_BOARD_ROT", 7.0)]), 0.0, 1);
        assert!((board - Rotation::new(7.0).unwrap().matrix()).norm() < 1e-12, "{board}");
    }

    /// By hand: a compass turned by 30 deg to the right has a field along its nose 30 deg to the right; a board on its back
    /// (z up, y to the left) that is trimmed by 10 deg of yaw turns what it has into the body's axes first.
    #[test]
    fn px4s_own_angles_and_the_boards_trim_turn_the_field() {
        let own = px4_mounting(&parameters(&[("CAL_MAG0_ROT", 100.0), ("CAL_MAG0_YAW", 30.0)]), 0.0, 0);
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        assert!((own * Vector3::x() - Vector3::new(cos, sin, 0.0)).norm() < 1e-12, "{own}");
        let trimmed = [("CAL_MAG0_ROT", -1.0), ("SENS_BOARD_ROT", 8.0), ("SENS_BOARD_Z_OFF", 10.0)];
        let board = px4_mounting(&parameters(&trimmed), 0.0, 0);
        let (sin, cos) = 10_f64.to_radians().sin_cos();
        assert!((board * Vector3::y() - Vector3::new(sin, -cos, 0.0)).norm() < 1e-12, "{board}");
        // A compass of its own place does not follow the board.
        let external = [("CAL_MAG0_ROT", 0.0), ("SENS_BOARD_ROT", 8.0), ("SENS_BOARD_Z_OFF", 10.0)];
        assert_eq!(px4_mounting(&parameters(&external), 0.0, 0), Matrix3::identity());
    }

    /// What goes with the throttle (1) is no iron per ampere: no log tells the throttle that it went by.
    #[test]
    fn what_ardupilot_takes_off_by_throttle_is_not_taken_for_a_current() {
        for (kind, by_current_ut) in [(0.0, 0.0), (1.0, 0.0), (2.0, -0.5)] {
            let told = parameters(&[("COMPASS_MOTCT", kind), ("COMPASS_MOT_X", 5.0)]);
            let iron = Undo::ardupilot(&told, 0.0, 1).iron;
            assert!((iron.by_current_ut - Vector3::new(by_current_ut, 0.0, 0.0)).norm() < 1e-9, "{kind}: {iron:?}");
        }
    }

    /// PX4 takes a calibration with a scale of nothing for none.
    #[test]
    fn a_scale_of_nothing_is_one_to_px4() {
        for (scale, used) in [(0.0, 1.0), (-1.0, 1.0), (0.5, 0.5)] {
            let told = parameters(&[("CAL_MAG0_YSCALE", scale), ("CAL_MAG0_XOFF", 0.1)]);
            let iron = Undo::px4(&told, 0.0, 0).iron;
            let expected = Matrix3::from_diagonal(&Vector3::new(1.0, used, 1.0));
            assert!((iron.matrix - expected).norm() < 1e-9, "{scale}: {iron:?}");
            assert!((iron.centre_ut - Vector3::new(10.0, 0.0, 0.0)).norm() < 1e-9, "{scale}: {iron:?}");
        }
    }
}
