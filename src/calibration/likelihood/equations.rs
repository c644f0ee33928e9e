//! What one sample says, as equations linear in the unknowns, each with its weight.

use nalgebra::Vector3;

use super::noise::{Covariance, Noise};
use super::unknowns::Row;
use super::{Config, Parameters, Prediction};
use crate::calibration::Rates;
use crate::frames::{Tilt, wrap_pi};

/// One equation: `row . change = -residual`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equation {
    /// Derivative of the residual by the unknowns.
    pub row: Row,
    pub residual: f32,
    /// Weight of the squared residual: the inverse variance, times Huber's weight.
    pub weight: f32,
    /// Huber's loss: half the square of the residual over sigma, and linear beyond `huber` sigmas (P. J. Huber, "Robust
    /// estimation of a location parameter", Annals of Mathematical Statistics 35, 1964).
    pub loss: f32,
    /// Square of the residual over sigma, clipped at [`CLIP`].
    pub clipped_square: f32,
}

/// Residuals are clipped here when their sigma is estimated.
const CLIP: f32 = 2.0;
/// The mean of the clipped square of a normal variable: Huber's proposal 2, which one sample in twenty may spoil
/// without harm.
pub(in crate::calibration) const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

impl Equation {
    /// Of a residual with its derivative and variance; `huber` is where the loss becomes linear, in sigmas.
    pub fn new(row: Row, residual: f32, variance: f32, huber: f32) -> Self {
        let information = 1.0 / variance;
        let square = residual * residual * information;
        let (weight, loss) = if square <= huber * huber {
            (information, 0.5 * square)
        } else {
            let size = libm::sqrtf(square);
            (information * huber / size, huber * (size - 0.5 * huber))
        };
        Self { row, residual, weight, loss, clipped_square: square.min(CLIP * CLIP) }
    }

    /// Residual over sigma, clipped.
    pub fn clipped(&self) -> f32 {
        libm::sqrtf(self.clipped_square).copysign(self.residual)
    }
}

/// The equations of one sample. With `w = W x + d` the corrected field in the unit of field, `C` the rotation of the
/// sample's attitude from body to level axes (Liu 2007 eq. 7), and `l = C w / |w|`:
///
/// | residual | derivative by the unknowns | variance |
/// |---|---|---|
/// | `e_norm = |w| - 1` | [`Prediction::norm_row`] | the sensor's |
/// | `e_dip = atan2(l_z, sqrt(l_x^2 + l_y^2)) - I` | [`Prediction::dip_row`] | the sensor's and the attitude's |
/// | `e_heading = atan2(-l_y, l_x) - given` | [`Prediction::heading_row`] | these, and that of what was given |
///
/// `w` is Liu 2007 eq. 8 solved for the field, the heading its eq. 3. The first two say that the Earth field has one
/// size and one inclination wherever the aircraft points, which its eq. 7 implies and its method does not use.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equations {
    /// The total field is one: `e_norm`.
    pub norm: Equation,
    /// The dip is the inclination, less what the norm's residual already says of it: `e_dip - slope e_norm`, with the
    /// `slope` of the noise's [`Covariance`], which makes the two independent. Absent where no attitude is known.
    pub dip: Option<Equation>,
    /// The heading is the given one: `e_heading`.
    pub heading: Option<Equation>,
    /// Change of the dip by a radian of roll bias, of pitch bias, by a relative bank error of one, and by a second that the
    /// attitude is too old.
    pub attitude_effects: [f32; 4],
}

/// A sample, ready to be looked at.
pub(in crate::calibration) struct Measured {
    /// The field less the mean of all samples, in mount axes and the unit of field.
    pub x: Vector3<f32>,
    /// The rotation of its attitude.
    pub tilt: Tilt,
    pub roll_rad: f32,
    /// How fast that and pitch change.
    pub rates: Rates,
    /// The heading, where it was given.
    pub heading_rad: Option<f32>,
}

impl Equations {
    /// `refined` says whether the coefficients are good enough for their residuals to say how the measurement was
    /// wrong: see [`corrected`].
    pub fn new(parameters: &Parameters, measured: &Measured, noise: &Noise, config: &Config, refined: bool) -> Self {
        let prediction = parameters.predict(measured.x, &measured.tilt);
        let by_attitude = prediction.dip_by_attitude(&measured.tilt);
        let covariance = noise.covariance(&prediction.direction, &prediction.towards_down, by_attitude);
        let residuals = Residuals::new(parameters, &prediction);
        let (prediction, Residuals { norm, dip }) = if refined {
            corrected(parameters, measured, noise, &covariance, &prediction, &residuals, config)
        } else {
            (prediction, residuals)
        };
        let norm_row = prediction.norm_row();
        Self {
            dip: config.uses_attitude.then(|| {
                let mut row = prediction.dip_row();
                row.by_field -= norm_row.by_field * covariance.slope;
                Equation::new(row, dip - norm * covariance.slope, covariance.dip, config.huber)
            }),
            heading: measured.heading_rad.map(|given_rad| heading(measured, noise, config, &prediction, given_rad)),
            norm: Equation::new(norm_row, norm, covariance.norm, config.huber),
            attitude_effects: attitude_effects(measured, by_attitude),
        }
    }
}

/// Of the derivatives of the dip by roll and by pitch, those by what can be wrong with an attitude source.
fn attitude_effects(measured: &Measured, [by_roll, by_pitch]: [f32; 2]) -> [f32; 4] {
    let by_latency = by_roll * measured.rates.roll_rad_s() + by_pitch * measured.rates.pitch_rad_s();
    [by_roll, by_pitch, by_roll * measured.roll_rad, by_latency]
}

impl Equations {
    /// Those that there are.
    pub fn all(&self) -> impl Iterator<Item = &Equation> {
        core::iter::once(&self.norm).chain(&self.dip).chain(&self.heading)
    }
}

/// `e_norm`, and `e_dip` in radians.
struct Residuals {
    norm: f32,
    dip: f32,
}

impl Residuals {
    fn new(parameters: &Parameters, prediction: &Prediction) -> Self {
        Self { norm: prediction.total - 1.0, dip: wrap_pi(prediction.dip_rad - parameters.inclination_rad) }
    }
}

/// Noise stands in the derivatives as well as in the residual, and where both hold the same noise the sum of their
/// products does not vanish: at 1 % of sensor noise, 15 deg of bank and 70 deg of inclination that bias was as large as
/// the random error. So the derivatives are taken at the measurement as it most likely was, moved by what the residuals
/// say of the sensor's error; what the move does to the residuals is taken back to first order (orthogonal distance
/// regression: P. T. Boggs and J. E. Rogers, Contemporary Mathematics 112, 1990). An attitude error needs no such care:
/// it turns the down direction towards or away from the field, which leaves the derivative's direction as it is.
fn corrected(
    parameters: &Parameters,
    measured: &Measured,
    noise: &Noise,
    covariance: &Covariance,
    prediction: &Prediction,
    &Residuals { norm, dip }: &Residuals,
    config: &Config,
) -> (Prediction, Residuals) {
    // A residual over its variance, the residual no larger than Huber's limit.
    let bounded = |residual: f32, variance: f32| {
        let limit_squared = config.huber * config.huber * variance;
        let is_small = residual * residual <= limit_squared;
        (if is_small { residual } else { libm::sqrtf(limit_squared).copysign(residual) }) / variance
    };
    let by_dip = if config.uses_attitude { bounded(dip - norm * covariance.slope, covariance.dip) } else { 0.0 };
    let by_norm = bounded(norm, covariance.norm) - covariance.slope * by_dip;
    let move_x = noise.sensor_move(&(prediction.direction * by_norm + prediction.towards_down * by_dip));
    let moved = parameters.predict(prediction.x - move_x, &measured.tilt);
    let move_body = parameters.w * move_x;
    let there = Residuals::new(parameters, &moved);
    let residuals = Residuals {
        norm: there.norm + moved.direction.dot(&move_body),
        dip: there.dip + moved.towards_down.dot(&move_body),
    };
    (moved, residuals)
}

/// `e_heading` of a sample whose heading was given.
fn heading(measured: &Measured, noise: &Noise, config: &Config, prediction: &Prediction, given_rad: f32) -> Equation {
    let by_field = prediction.heading_by_field(&measured.tilt);
    let variance =
        config.given_heading_sigma_rad * config.given_heading_sigma_rad + noise.heading_variance(&by_field, prediction);
    let residual = wrap_pi(prediction.heading_rad() - given_rad);
    Equation::new(prediction.heading_row(&measured.tilt), residual, variance, config.huber)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use nalgebra::Matrix3;

    use super::super::unknowns::Vector13;
    use super::*;
    use crate::frames::Attitude;

    fn close(found: f32, expected: f32) -> bool {
        (found - expected).abs() <= 2e-4 * expected.abs()
    }

    /// Of so many sigmas, as the module weighs it.
    fn equation(sigmas: f32) -> Equation {
        let row = Row { by_field: Vector3::zeros(), x: Vector3::zeros(), by_inclination: 0.0 };
        Equation::new(row, sigmas * 0.1, 0.01, Config::DEFAULT.huber)
    }

    /// Least squares up to two sigmas: a twentieth of what is normal lies beyond. From there each more sigma costs as
    /// much as the last, whatever its sign.
    #[test]
    fn an_outlier_counts_linearly() {
        for (sigmas, weight, loss) in [
            (0.5, 100.0, 0.125),
            (1.98, 100.0, 1.9602),
            (2.02, 100.0 * 2.0 / 2.02, 2.0 + 2.0 * 0.02),
            (8.0, 25.0, 2.0 + 2.0 * 6.0),
        ] {
            for sigmas in [sigmas, -sigmas] {
                let equation = equation(sigmas);
                assert!(close(equation.weight, weight) && close(equation.loss, loss), "{sigmas}: {equation:?}");
            }
        }
    }

    /// What estimates the noise is clipped at two sigmas and keeps its sign.
    #[test]
    fn a_residual_is_clipped() {
        for (sigmas, clipped) in [(0.5, 0.5), (1.98, 1.98), (2.02, 2.0), (30.0, 2.0)] {
            assert!(close(equation(sigmas).clipped_square, clipped * clipped), "{sigmas}");
            assert!(close(equation(sigmas).clipped(), clipped) && close(equation(-sigmas).clipped(), -clipped));
        }
    }

    /// The integral of the clipped square over the normal distribution, in steps of a thousandth of sigma.
    #[test]
    fn normal_noise_is_estimated_right() {
        let density = |z: f64| (-0.5 * z * z).exp() / core::f64::consts::TAU.sqrt();
        let clip = f64::from(CLIP).powi(2);
        let mean: f64 =
            (-10_000..10_000).map(|i| (f64::from(i) + 0.5) * 1e-3).map(|z| density(z) * (z * z).min(clip) * 1e-3).sum();
        assert!((f64::from(CLIPPED_MEAN_SQUARE) / mean - 1.0).abs() < 1e-3, "{mean}");
    }

    /// A tumbled sample has no dip, however its attitude is said to be.
    #[test]
    fn without_attitude_there_is_no_dip() {
        let parameters = Parameters { w: Matrix3::identity(), d: Vector3::zeros(), inclination_rad: 1.0 };
        let tilt = Attitude::from_deg(20.0, 0.0).tilt();
        let measured =
            Measured { x: Vector3::new(0.6, 0.0, 0.8), tilt, roll_rad: 0.0, rates: Rates::NONE, heading_rad: None };
        let equations = |config| Equations::new(&parameters, &measured, &Noise::INITIAL, &config, true);
        assert!(equations(Config::DEFAULT).dip.is_some() && equations(Config::ALIGNED).dip.is_some());
        assert!(equations(Config::NO_ATTITUDE).dip.is_none());
        assert!(equations(Config::DEFAULT).heading.is_none());
    }

    /// The expected gradient at the truth, over all headings at 15 deg of bank either way and 70 deg of inclination, in
    /// units of its standard deviation: 1 % of sensor noise, as the six points that have its mean and covariance.
    fn expected_gradient(refined: bool) -> f32 {
        let parameters = Parameters {
            w: Matrix3::new(1.1, 0.1, -0.05, 0.0, 0.9, 0.1, 0.05, -0.1, 1.05),
            d: Vector3::new(0.1, -0.2, 0.6),
            inclination_rad: 70_f32.to_radians(),
        };
        let sigma = 0.01;
        let noise = Noise::new(sigma, 0.011, parameters.w);
        let mut gradient = Vector13::zeros();
        let mut information = Vector13::zeros();
        for (bank_deg, step) in
            [-15.0, 15.0].into_iter().flat_map(|bank_deg| (0..128_u8).map(move |step| (bank_deg, step)))
        {
            let attitude = Attitude::from_deg(bank_deg, 0.0);
            let tilt = attitude.tilt();
            let exact = parameters.expected_field(&tilt, f32::from(step) / 128.0 * TAU).unwrap();
            for (axis, sign) in [(0, 1.0), (1, 1.0), (2, 1.0), (0, -1.0), (1, -1.0), (2, -1.0)] {
                let x = exact + Vector3::ith(axis, sign * sigma * 3_f32.sqrt());
                let measured = Measured { x, tilt, roll_rad: attitude.roll_rad, rates: Rates::NONE, heading_rad: None };
                let equations = Equations::new(&parameters, &measured, &noise, &Config::DEFAULT, refined);
                for equation in [Some(&equations.norm), equations.dip.as_ref()].into_iter().flatten() {
                    let row = equation.row.dense();
                    gradient += row * (equation.weight * equation.residual / 6.0);
                    information += row.component_mul(&row) * (equation.weight / 6.0);
                }
            }
        }
        gradient.component_div(&information.map(f32::sqrt)).amax()
    }

    /// Noise stands in residual and derivative both: without correction the product of the two pulls the solution by
    /// half a sigma of a flight of 2 x 128 samples; with it, by a third of that, for it is a correction of first order.
    #[test]
    fn noise_pulls_nowhere_once_measurements_are_corrected() {
        let (corrected, not) = (expected_gradient(true), expected_gradient(false));
        assert!(corrected < 0.5 * not && not > 0.4, "{corrected} {not}");
    }

    /// Where the measurement most likely was: its error given both residuals, `S J^T (J S J^T + R)^-1 e`, with `S` the
    /// sensor's covariance, `J` the derivatives of norm and dip by the measurement, and `R` the attitude's share of the
    /// dip. An outlier moves it by no more than its part of two sigmas.
    #[test]
    fn the_measurement_moves_to_where_it_most_likely_was() {
        let noise_w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
        let noise = Noise::new(0.01, 0.015, noise_w);
        let tilt = Attitude::from_deg(25.0, 5.0).tilt();
        let mut parameters = Parameters { w: noise_w, d: Vector3::new(0.1, 0.0, 0.2), inclination_rad: 1.0 };
        let measured = Measured {
            x: parameters.expected_field(&tilt, 0.7).unwrap() + Vector3::new(0.004, -0.006, 0.005),
            tilt,
            roll_rad: 0.4,
            rates: Rates::NONE,
            heading_rad: None,
        };
        let moved_by = |parameters: &Parameters| {
            let prediction = parameters.predict(measured.x, &tilt);
            let by_attitude = prediction.dip_by_attitude(&tilt);
            let covariance = noise.covariance(&prediction.direction, &prediction.towards_down, by_attitude);
            let residuals = Residuals::new(parameters, &prediction);
            let config = &Config::DEFAULT;
            let (moved, _) = corrected(parameters, &measured, &noise, &covariance, &prediction, &residuals, config);
            (measured.x - moved.x, prediction, residuals)
        };
        let (found, prediction, residuals) = moved_by(&parameters);
        let by_x = [noise_w.tr_mul(&prediction.direction), noise_w.tr_mul(&prediction.towards_down)];
        let [roll, pitch] = prediction.dip_by_attitude(&tilt);
        let attitude = (0.015_f32.powi(2) - 1e-4) * (roll * roll + pitch * pitch);
        let of = |i: usize, j: usize| by_x[i].dot(&by_x[j]) * 1e-4 + if (i, j) == (1, 1) { attitude } else { 0.0 };
        let inverse = nalgebra::Matrix2::new(of(0, 0), of(0, 1), of(1, 0), of(1, 1)).try_inverse().unwrap();
        let [norm, dip] = (inverse * nalgebra::Vector2::new(residuals.norm, residuals.dip)).into();
        let expected = (by_x[0] * norm + by_x[1] * dip) * 1e-4;
        assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");

        // A dip that is off by a radian counts as one that is off by two sigmas of what norm leaves of it.
        parameters.inclination_rad -= 1.0;
        let (found, _, residuals) = moved_by(&parameters);
        let slope = of(0, 1) / of(0, 0);
        let left = of(1, 1) - slope * of(0, 1);
        let by_dip = 2.0 / left.sqrt();
        let expected = (by_x[0] * (residuals.norm / of(0, 0) - slope * by_dip) + by_x[1] * by_dip) * 1e-4;
        assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
    }

    /// A compass rose is good to a degree; the module's own noise comes to that.
    #[test]
    fn a_given_heading_is_as_good_as_its_giver_and_the_measurement() {
        let parameters = Parameters { w: Matrix3::identity(), d: Vector3::zeros(), inclination_rad: 0.9 };
        let tilt = Attitude::from_deg(10.0, 0.0).tilt();
        let x = parameters.expected_field(&tilt, 0.7).unwrap();
        let measured = Measured { x, tilt, roll_rad: 0.0, rates: Rates::NONE, heading_rad: Some(0.69) };
        for noise in [Noise::new(1e-6, 1e-6, Matrix3::identity()), Noise::new(0.01, 0.02, Matrix3::identity())] {
            let prediction = parameters.predict(x, &tilt);
            let own = noise.heading_variance(&prediction.heading_by_field(&tilt), &prediction);
            let equation = Equations::new(&parameters, &measured, &noise, &Config::DEFAULT, false).heading.unwrap();
            assert!((equation.residual - 0.01).abs() < 1e-5);
            assert!(close(1.0 / equation.weight, 0.0175 * 0.0175 + own), "{} {own}", 1.0 / equation.weight);
        }
    }
}
