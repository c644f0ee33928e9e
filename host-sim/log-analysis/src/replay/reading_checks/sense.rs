//! Whether the signs of field, attitude and body rates agree.
//!
//! A field fixed to the Earth turns against the body: `dh/dt = h x w`. About one or two axes the field of a mirrored
//! sensor turns the wrong way, and so does the field against the rates of an attitude with a wrong sign. Without rates, the
//! fit to the field as read is compared with fits to its mirror images.

use autoswing::frames::{RollPitch, wrap_pi};
use nalgebra::{Matrix3, SMatrix, Vector1, Vector2, Vector3};

use super::check::CheckOutcome;
use crate::least_squares::LeastSquares;
use crate::log::time_series::pairs_apart;
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::mean;
use crate::replay::evaluation::FlightEvaluation;
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::{ReplayRow, heading_deg};
use crate::replay::row_headings::heading_scatter;
use crate::replay::row_solve::{is_determined, solved_correction};
use crate::score::wrap_180;

/// Shortest and longest time between the two rows of a turn, seconds: the field turns by more than its noise, and the
/// rates between are known.
const TURN_TIME_S: [f64; 2] = [0.4, 1.2];

/// Fraction of the expected turn above which the sense is right, and below whose negative it is wrong.
const MIN_TURN_FRACTION: f64 = 0.5;

/// Largest standard deviation of that fraction at which an axis counts.
const MAX_FRACTION_SIGMA: f64 = 0.15;

/// Successive turns overlap and share errors: as many of them count as one.
const OVERLAPPING_TURNS: f64 = 20.0;

/// Minimum number of turns.
const MIN_TURN_COUNT: usize = 21;

/// Ratio of the residuals of two fits at which the better one is the right one.
const MIN_RESIDUAL_RATIO: f64 = 1.6;

/// Largest residual of a fit that is right, degrees.
const MAX_RESIDUAL_DEG: f64 = 5.0;

/// Smallest residual of a fit, degrees: that of sensor and attitude noise.
const MIN_RESIDUAL_DEG: f64 = 0.3;

/// Checks the signs of field and attitude by the body rates and by the fit.
pub(super) fn check_sense(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    rows: &[ReplayRow],
    correction: Option<&FieldCorrection>,
) -> CheckOutcome {
    // Differences of an attitude without yaw have no turn.
    let has_rates = flight.has_measured_rates || flight.has_yaw();
    let turn_fractions = |signs: [f32; 3]| if has_rates { turn_fractions(rows, correction, signs) } else { [None; 3] };
    let [by_logged_rates, fractions] = [flight.logged_rate_signs, [1.0; 3]].map(turn_fractions);
    let agrees = |fractions: &[Option<f64>]| !fractions.iter().copied().any(is_reversed);
    if !agrees(&fractions) && !agrees(&by_logged_rates) {
        return CheckOutcome::Failed(cause_of_wrong_sense(rows, fractions, evaluation.earth_inclination_deg()));
    }
    if flight.has_measured_rates
        && agrees(&by_logged_rates)
        && let Some(angle) = reversed_angle(rows, flight.logged_rate_signs)
    {
        return CheckOutcome::Failed(format!("field and body rates contradict the sign of {angle}"));
    }
    let is_right = |fraction: f64| fraction > MIN_TURN_FRACTION;
    if fractions.iter().flatten().count() > 0 && fractions.into_iter().flatten().all(is_right) {
        return CheckOutcome::Passed;
    }
    let [as_read_deg, mirrored_deg] = if is_tilting(rows) { residuals_deg(rows) } else { [f64::NAN; 2] };
    if as_read_deg > MIN_RESIDUAL_RATIO * mirrored_deg && mirrored_deg < MAX_RESIDUAL_DEG {
        return CheckOutcome::Failed(
            "the mirror image of the field fits the attitude, and the field does not: the sign of roll, of pitch, or of an \
             axis of the field is wrong"
                .to_owned(),
        );
    }
    let is_fit_better = mirrored_deg > MIN_RESIDUAL_RATIO * as_read_deg && as_read_deg < MAX_RESIDUAL_DEG;
    if is_fit_better || turn_fraction_by_reference(rows, correction).is_some_and(is_right) {
        CheckOutcome::Passed
    } else {
        CheckOutcome::unchecked(
            "body rates, yaw or tilts that would confirm the signs of field and attitude are missing",
        )
    }
}

/// Checks that the reference heading turns with the heading by the fit.
pub(super) fn check_reference(
    evaluation: &FlightEvaluation,
    rows: &[ReplayRow],
    correction: Option<&FieldCorrection>,
) -> CheckOutcome {
    let Some(reference) = evaluation.reference.as_ref().filter(|reference| reference.measures_error()) else {
        return CheckOutcome::unchecked("the log has no reference heading that is made without a compass");
    };
    match turn_fraction_by_reference(rows, correction) {
        None => CheckOutcome::unchecked("the reference hardly turns"),
        Some(fraction) if fraction < -MIN_TURN_FRACTION => CheckOutcome::Failed(format!(
            "{} turns against the heading: it counts anticlockwise, as an angle from east does",
            reference.reference_name()
        )),
        Some(_) => CheckOutcome::Passed,
    }
}

fn is_reversed(fraction: Option<f64>) -> bool {
    fraction.is_some_and(|fraction| fraction < -MIN_TURN_FRACTION)
}

/// The angle whose sign is wrong, by body rates that the field confirms.
fn reversed_angle(rows: &[ReplayRow], rate_signs: [f32; 3]) -> Option<&'static str> {
    let fractions = |angle_signs: [f32; 2]| tilt_fractions(rows, angle_signs, rate_signs);
    if !fractions([1.0, 1.0]).into_iter().any(is_reversed) {
        return None;
    }
    let is_right = |signs: [f32; 2]| !fractions(signs).into_iter().any(is_reversed);
    let candidates = [([-1.0, 1.0], "roll"), ([1.0, -1.0], "pitch"), ([-1.0, -1.0], "roll and pitch")];
    Some(candidates.into_iter().find(|(signs, _)| is_right(*signs)).map_or("roll or pitch", |(_, angle)| angle))
}

/// Cause of a field that turns the wrong way about some axes. A mirrored axis and a sensor turned upside down about it
/// differ only in the sign of the inclination: about the two other axes the field turns the wrong way.
fn cause_of_wrong_sense(rows: &[ReplayRow], fractions: [Option<f64>; 3], model_inclination_deg: Option<f64>) -> String {
    /// Inclination whose sign is certain, degrees.
    const MIN_INCLINATION_DEG: f64 = 10.0;
    let is_wrong = fractions.map(is_reversed);
    let is_right = fractions.map(|fraction| fraction.is_some_and(|fraction| fraction > MIN_TURN_FRACTION));
    let axes = |are: [bool; 3]| (0..3).filter(|&axis| are[axis]).collect::<Vec<_>>();
    match (axes(is_wrong).as_slice(), axes(is_right).as_slice()) {
        (&[wrong], &[_, _]) => {
            format!("the field contradicts the sign of {}", ["roll", "pitch", "yaw"][wrong])
        }
        (&[_, _], &[axis]) => {
            let (axis_name, turn_name) = [("x", "roll180"), ("y", "pitch180"), ("z", "yaw180")][axis];
            let mirrored = format!("the {axis_name} axis of the field is mirrored");
            let turned = format!("the sensor is turned by {turn_name} against its orientation setting");
            let steep_deg = model_inclination_deg.filter(|model_deg| model_deg.abs() > MIN_INCLINATION_DEG);
            match inclination_after_half_turn_deg(rows, axis).zip(steep_deg) {
                Some((found_deg, model_deg)) if found_deg * model_deg < 0.0 => mirrored,
                Some(_) => turned,
                None => {
                    format!("{turned}, or {mirrored}; the log has no place with an inclination that tells them apart")
                }
            }
        }
        (wrong, _) => {
            let names: Vec<&str> = wrong.iter().map(|&axis| ["x", "y", "z"][axis]).collect();
            format!(
                "the field turns with the aircraft about {}, not against it: the sign of an axis of the field, or of the \
                 attitude, is wrong",
                names.join(" and ")
            )
        }
    }
}

/// Inclination of the fit to the field turned by half a turn about an axis, degrees.
fn inclination_after_half_turn_deg(rows: &[ReplayRow], axis: usize) -> Option<f64> {
    let mut half_turn = -Matrix3::identity();
    half_turn[(axis, axis)] = 1.0;
    let turned: Vec<ReplayRow> = rows.iter().map(|row| row.in_rotated_axes(&half_turn)).collect();
    Some(f64::from(solve_all_rows(&turned)?.calibration.inclination_rad.to_degrees()))
}

/// Whether the tilts suffice to distinguish the field from its mirror image.
fn is_tilting(rows: &[ReplayRow]) -> bool {
    /// Largest tilt, radians (5 deg).
    const MIN_TILT_RAD: f32 = 0.087;
    rows.iter().any(|row| row.attitude.roll_rad.abs().max(row.attitude.pitch_rad.abs()) > MIN_TILT_RAD)
}

/// Residuals of the fits to the field as read, and to its best mirror image, degrees.
fn residuals_deg(rows: &[ReplayRow]) -> [f64; 2] {
    let mirrored =
        (0..3).map(|axis| fit_residual_deg(rows, std::array::from_fn(|i| if i == axis { -1.0 } else { 1.0 })));
    [fit_residual_deg(rows, [1.0; 3]), mirrored.fold(f64::INFINITY, f64::min)]
}

/// Residual of the fit to a field with these signs of its axes, as a heading error in degrees; infinite without a fit
/// that the flight determines.
fn fit_residual_deg(rows: &[ReplayRow], field_signs: [f64; 3]) -> f64 {
    let mirror = Matrix3::from_diagonal(&Vector3::from(field_signs));
    let mirrored: Vec<ReplayRow> = rows.iter().map(|row| row.in_rotated_axes(&mirror)).collect();
    let Some(solution) = solve_all_rows(&mirrored).filter(is_determined) else { return f64::INFINITY };
    let correction = solved_correction(&solution);
    let [by_strength_deg, by_inclination_deg] = heading_scatter(&mirrored, &|row| row.corrected_field(&correction));
    libm::hypot(by_strength_deg, by_inclination_deg).max(MIN_RESIDUAL_DEG)
}

/// Turn of the field about each body axis as a fraction of the turn that the rates give: 1 if signs and units are right;
/// none for an axis that the aircraft hardly turned about. Least squares of `dm/dt = sum w_i (k_i m x e_i + g_i)`, where
/// `g_i`, across axis `i`, is the part of a remaining hard iron.
fn turn_fractions(rows: &[ReplayRow], correction: Option<&FieldCorrection>, rate_signs: [f32; 3]) -> [Option<f64>; 3] {
    let fields = corrected_fields(rows, correction);
    let mut fit = LeastSquares::<9>::new();
    for turn in measured_turns(rows, &fields, rate_signs) {
        let mut columns = SMatrix::<f64, 3, 9>::zeros();
        for axis in 0..3 {
            let [next, after] = [(axis + 1) % 3, (axis + 2) % 3];
            columns.set_column(axis, &(turn.field.cross(&Vector3::ith_axis(axis)) * turn.rate[axis]));
            columns[(next, 3 + 2 * axis)] = turn.rate[axis];
            columns[(after, 4 + 2 * axis)] = turn.rate[axis];
        }
        add_turn(&mut fit, &columns, turn.change);
    }
    let Some(solved) = fit.solve_with_sigmas(3 * MIN_TURN_COUNT, OVERLAPPING_TURNS) else { return [None; 3] };
    std::array::from_fn(|axis| if_certain(solved[axis]))
}

/// A fraction with its standard deviation, if that is at most [`MAX_FRACTION_SIGMA`].
fn if_certain([fraction, sigma]: [f64; 2]) -> Option<f64> {
    (sigma < MAX_FRACTION_SIGMA).then_some(fraction)
}

/// Adds the change of the field in a turn, and its derivatives by the unknowns.
fn add_turn<const N: usize>(fit: &mut LeastSquares<N>, derivatives: &SMatrix<f64, 3, N>, change: Vector3<f64>) {
    for (axis, row) in derivatives.row_iter().enumerate() {
        fit.add_row(&row.transpose(), change[axis], 1.0);
    }
}

/// A turn of the body: mean rates, rad/s, mean field, microtesla, and change of the field, uT/s.
struct MeasuredTurn {
    rate: Vector3<f64>,
    field: Vector3<f64>,
    change: Vector3<f64>,
}

/// The turns of rows with body rates of these signs.
fn measured_turns<'a>(
    rows: &'a [ReplayRow],
    fields: &'a [Vector3<f64>],
    rate_signs: [f32; 3],
) -> impl Iterator<Item = MeasuredTurn> + 'a {
    turns(rows).filter_map(move |(first, last)| {
        let row_count = (last - first + 1) as f64;
        let rates: Option<Vec<_>> = rows[first..=last].iter().map(|row| row.rates_rad_s).collect();
        Some(MeasuredTurn {
            rate: rates?.iter().map(|rate| signed_rates(*rate, rate_signs)).sum::<Vector3<f64>>() / row_count,
            field: fields[first..=last].iter().sum::<Vector3<f64>>() / row_count,
            change: (fields[last] - fields[first]) / (rows[last].t_s - rows[first].t_s),
        })
    })
}

/// Angle about z from the axes of the corrected field to those of the body rates, degrees; none if rolls and pitches do not
/// determine it to 5 deg. A field `h`, turned by a small `d` from its true axes, changes by `dh/dt = h x w + h x (w x d)`; a
/// remaining hard iron `b` adds `w x b`.
pub fn misalignment_about_z_deg(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    /// Half of the angle that is looked for.
    const MAX_SIGMA_DEG: f64 = 5.0;
    let fields = corrected_fields(rows, Some(correction));
    let mut fit = LeastSquares::<6>::new();
    for turn in measured_turns(rows, &fields, [1.0; 3]) {
        let mut columns = SMatrix::<f64, 3, 6>::zeros();
        for axis in 0..3 {
            let across = turn.rate.cross(&Vector3::ith_axis(axis));
            columns.set_column(axis, &turn.field.cross(&across));
            columns.set_column(3 + axis, &across);
        }
        add_turn(&mut fit, &columns, turn.change - turn.field.cross(&turn.rate));
    }
    let solved = fit.solve_with_sigmas(3 * MIN_TURN_COUNT, OVERLAPPING_TURNS)?;
    let [angle_deg, sigma_deg] = solved[2].map(f64::to_degrees);
    (sigma_deg <= MAX_SIGMA_DEG).then_some(angle_deg)
}

/// Changes of roll and of pitch, with these signs, as fractions of the changes that the body rates give; constant offsets
/// of the rates are removed. None for an angle that hardly changed.
fn tilt_fractions(rows: &[ReplayRow], angle_signs: [f32; 2], rate_signs: [f32; 3]) -> [Option<f64>; 2] {
    let tilt = |row: &ReplayRow| RollPitch {
        roll_rad: row.attitude.roll_rad * angle_signs[0],
        pitch_rad: row.attitude.pitch_rad * angle_signs[1],
    };
    let rates = |row: &ReplayRow| Some(tilt_rates_rad_s(tilt(row), signed_rates(row.rates_rad_s?, rate_signs)));
    // The fraction, and the offset.
    let mut fits = [LeastSquares::<2>::new(); 2];
    for (first, last) in turns(rows) {
        let Some(by_rates) = rows[first..=last].iter().map(rates).collect::<Option<Vec<_>>>() else { continue };
        let (from, to) = (tilt(&rows[first]), tilt(&rows[last]));
        let change_rad = [wrap_pi(to.roll_rad - from.roll_rad), to.pitch_rad - from.pitch_rad];
        for angle in 0..2 {
            let mean = mean(by_rates.iter().map(|rates| rates[angle]));
            let rate = f64::from(change_rad[angle]) / (rows[last].t_s - rows[first].t_s);
            fits[angle].add_row(&Vector2::new(mean, 1.0), rate, 1.0);
        }
    }
    fits.map(|fit| if_certain(fit.solve_with_sigmas(MIN_TURN_COUNT, OVERLAPPING_TURNS)?[0]))
}

/// Body rates with these signs, rad/s.
fn signed_rates(rates_rad_s: [f32; 3], signs: [f32; 3]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| f64::from(rates_rad_s[axis] * signs[axis]))
}

/// Rates of roll and pitch by the body rates, rad/s.
fn tilt_rates_rad_s(tilt: RollPitch, body_rates: Vector3<f64>) -> [f64; 2] {
    let (sin_roll, cos_roll) = libm::sincos(f64::from(tilt.roll_rad));
    let tan_pitch = libm::tan(f64::from(tilt.pitch_rad));
    let [p, q, r] = body_rates.into();
    [p + (q * sin_roll + r * cos_roll) * tan_pitch, q * cos_roll - r * sin_roll]
}

/// Turn of the heading as a fraction of the turn of the reference; none if it hardly turned.
fn turn_fraction_by_reference(rows: &[ReplayRow], correction: Option<&FieldCorrection>) -> Option<f64> {
    /// Sum of the squared turns, square degrees: two hundred of a second at 6 deg/s.
    const MIN_TURNS_DEG2: f64 = 200.0 * 36.0;
    let fields = corrected_fields(rows, correction);
    let heading_deg = |index: usize| heading_deg(&rows[index], fields[index]);
    let mut fit = LeastSquares::<1>::new();
    for (first, last) in turns(rows) {
        let (Some(from_deg), Some(to_deg)) = (rows[first].reference_deg, rows[last].reference_deg) else { continue };
        let turn = Vector1::new(wrap_180(to_deg - from_deg));
        fit.add_row(&turn, wrap_180(heading_deg(last) - heading_deg(first)), 1.0);
    }
    fit.solve().filter(|_| fit.normal.x > MIN_TURNS_DEG2).map(|fraction| fraction.x)
}

/// First and last row of each turn.
fn turns(rows: &[ReplayRow]) -> impl Iterator<Item = (usize, usize)> + '_ {
    pairs_apart(rows, |row| row.t_s, TURN_TIME_S)
}

/// Corrected fields of the rows, microtesla; as logged without a correction.
fn corrected_fields(rows: &[ReplayRow], correction: Option<&FieldCorrection>) -> Vec<Vector3<f64>> {
    let field =
        |row: &ReplayRow| correction.map_or_else(|| row.logged_ut(), |correction| row.corrected_field(correction));
    rows.iter().map(field).collect()
}
