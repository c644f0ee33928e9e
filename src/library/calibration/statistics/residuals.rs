//! Statistics of the residuals of one pass over the samples.

use super::autocorrelation::Autocorrelation;
use super::discrepancy::Discrepancy;
use super::heteroscedasticity::Heteroscedasticity;
use super::white_noise_fraction::WhiteNoiseFraction;
use crate::calibration::fit::information_matrix::InformationMatrix;
use crate::calibration::model::Vector13;

#[derive(Clone, Debug)]
pub(in crate::calibration) struct ResidualStatistics {
    /// Information of the inclination residuals.
    pub inclination_information: InformationMatrix,
    /// Lag-1 autocorrelation of the norm and inclination residuals.
    pub autocorrelation: Autocorrelation,
    pub heteroscedasticity: Heteroscedasticity,
    pub discrepancy: Discrepancy,
    pub white_noise: WhiteNoiseFraction,
}

impl ResidualStatistics {
    pub fn zero() -> Self {
        Self {
            inclination_information: InformationMatrix::zero(),
            autocorrelation: Autocorrelation::default(),
            heteroscedasticity: Heteroscedasticity::default(),
            discrepancy: Discrepancy::default(),
            white_noise: WhiteNoiseFraction::default(),
        }
    }

    /// Variance inflation by autocorrelation, the larger of both residuals'.
    #[inline(never)]
    pub fn autocorrelation_inflation(&self) -> f32 {
        let [norm_excess, inclination_excess] = self.autocorrelation.excess_variance_inflation();
        1.0 + norm_excess.max(inclination_excess)
    }

    /// `(x - reference_inflation) H_incl vector`, `x` the variance inflation of the inclination residuals; at least 0.
    pub fn excess_inclination_information_times(&self, vector: &Vector13, reference_inflation: f32) -> Vector13 {
        let [_, inclination_excess] = self.autocorrelation.excess_variance_inflation();
        self.inclination_information.multiply_vector(vector) * (1.0 + inclination_excess - reference_inflation).max(0.0)
    }
}
