//! Statistical model of the samples: unknowns, predicted field, residuals, noise, priors.

mod equations;
mod likelihood;
mod noise;
mod prediction;
mod priors;
mod unknowns;

pub(super) use {
    equations::{CLIPPED_MEAN_SQUARE, MeasuredSample, ResidualEquation, SampleEquations},
    likelihood::Likelihood,
    noise::{ModelConfig, NoiseModel},
    prediction::{ModelParameters, heading_derivative_by_field, horizontal_squared},
    priors::{PriorQuantity, for_each_prior, scaled_unit_vector},
    unknowns::{
        COEFFICIENT_COUNT, INCLINATION_INDEX, UNKNOWN_COUNT, UPPER_TRIANGLE_3, UPPER_TRIANGLE_4, Vector12, Vector13,
        beta_index, coefficient_jacobian_row, corrected_mean_index, row_and_column, unknown_index_of_product, w_index,
    },
};
pub(crate) use {prediction::FieldPrediction, unknowns::JacobianRow};

#[cfg(test)]
pub(super) use unknowns::Matrix13;
