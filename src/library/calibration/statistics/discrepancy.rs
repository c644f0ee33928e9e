//! Model discrepancy: a field error that the model does not contain (M. C. Kennedy and A. O'Hagan, "Bayesian calibration
//! of computer models", J. R. Statist. Soc. B 63, 2001), whatever its cause.
//!
//! Noise averages out within a cluster of samples, a systematic error does not. Its variance follows from norm residuals:
//!
//! - by heading and side of the turn, by a one-way analysis of variance (H. Scheffe, The Analysis of Variance, 1959,
//!   7.2): iron that answers the field otherwise than linearly. Clipped, so that power lines do not count;
//! - in the first seconds of a part of the flight: iron that follows a manoeuvre.
//!
//! Inclination residuals do not count: errors of the attitude source last for seconds, too, and have hypotheses.

use crate::calibration::model::{NoiseModel, SampleEquations};
use crate::calibration::types::samples::{PART_COUNT, Sample};
use crate::time::WrappingMillis;
use crate::trig::sqrt;

/// Variance of the field error across the field over that of the norm residuals, which show it along the field: of the
/// two harmonics on each of two circles, ten of norm and ten of inclination, the thirteen unknowns absorb thirteen,
/// which alone is a factor of 3. Measured with soft iron that has a play on each axis: 2 to 6.
const VARIANCE_RATIO: f32 = 6.0;

/// Duration of the beginning of a part of the flight, milliseconds.
const ENTRY_MS: u32 = 8_000;

/// Squared mean of the residuals of a beginning that noise explains, in its variances: three sigmas.
const ENTRY_SIGNIFICANCE: f32 = 9.0;

/// Number of clusters by heading: eight on each side.
const HEADING_CLUSTER_COUNT: usize = 16;

/// Sum and number of the residuals of a cluster of samples.
#[derive(Clone, Copy, Debug, Default)]
struct Cluster {
    sum: f32,
    sample_count: f32,
}

impl Cluster {
    fn add_residual(&mut self, residual: f32) {
        self.sum += residual;
        self.sample_count += 1.0;
    }
}

/// One-way analysis of variance of normalised residuals.
#[derive(Clone, Copy, Debug, Default)]
struct VarianceAnalysis {
    squares: f32,
    sample_count: f32,
    squares_between: f32,
    cluster_count: f32,
}

impl VarianceAnalysis {
    fn add_residual(&mut self, residual: f32) {
        self.squares += residual * residual;
        self.sample_count += 1.0;
    }

    fn add_cluster(&mut self, cluster: Cluster) {
        if cluster.sample_count > 0.0 {
            self.squares_between += cluster.sum * cluster.sum / cluster.sample_count;
            self.cluster_count += 1.0;
        }
    }

    /// Variance within the clusters.
    fn variance_within(&self) -> f32 {
        (self.squares - self.squares_between) / (self.sample_count - self.cluster_count).max(1.0)
    }

    /// Variance between the clusters beyond that of the noise, which has a chi-squared distribution, and two of its sigmas;
    /// at least 0.
    fn variance_between(&self) -> f32 {
        let by_noise = (self.cluster_count + 2.0 * sqrt(2.0 * self.cluster_count)) * self.variance_within();
        ((self.squares_between - by_noise) / self.sample_count.max(1.0)).max(0.0)
    }
}

/// Sums over the samples of a flight, in order of time.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::calibration) struct Discrepancy {
    analysis: VarianceAnalysis,
    by_heading: [Cluster; HEADING_CLUSTER_COUNT],
    part_starts: [Option<WrappingMillis>; PART_COUNT],
    entries: [Cluster; PART_COUNT],
}

impl Discrepancy {
    /// Adds the norm residual of a sample of a part.
    pub fn add_sample(&mut self, part: usize, sample: &Sample, equations: &SampleEquations) {
        let equation = &equations.norm_equation;
        let clipped = equation.clipped_residual();
        self.analysis.add_residual(clipped);
        if let Some(cluster) = self.by_heading.get_mut(heading_cluster(sample, equations)) {
            cluster.add_residual(clipped);
        }
        if let (Some(start), Some(entry)) = (self.part_starts.get_mut(part), self.entries.get_mut(part))
            && sample.time.ms_since(*start.get_or_insert(sample.time)) < ENTRY_MS
        {
            entry.add_residual(equation.residual);
        }
    }

    /// Variance of the field error on an axis, square units of the total field.
    pub fn field_variance(&self, noise: &NoiseModel) -> f32 {
        let mut analysis = self.analysis;
        self.by_heading.iter().for_each(|cluster| analysis.add_cluster(*cluster));
        let unit = noise.norm_sigma * noise.norm_sigma;
        let by_noise = ENTRY_SIGNIFICANCE * unit * analysis.variance_within();
        let of_entry = |&Cluster { sum, sample_count }: &Cluster| (sum * sum / sample_count - by_noise) / sample_count;
        let at_entries = self.entries.iter().map(of_entry).fold(0.0, f32::max);
        VARIANCE_RATIO * (unit * analysis.variance_between() + at_entries)
    }
}

/// Octant of the heading, by its sine and cosine up to a common factor, and side of the turn.
fn heading_cluster(sample: &Sample, equations: &SampleEquations) -> usize {
    let [sine, cosine] = equations.inclination_derivatives_by_attitude;
    let is_right_turn =
        if sample.rates.is_known() { sample.rates.heading_rad_s() > 0.0 } else { sample.attitude.roll_rad > 0.0 };
    let bits = [sine > 0.0, cosine > 0.0, sine.abs() > cosine.abs(), is_right_turn];
    bits.into_iter().fold(0, |number, bit| 2 * number + usize::from(bit))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two clusters of three with means 1 and -1 and residuals that differ by 0.3 from them: a variance of 1, less six
    /// sixths of that within. Equal means are explained by noise.
    #[test]
    fn the_variance_between_clusters_is_beyond_that_of_the_noise() {
        for (mean, expected) in [(1.0_f32, 1.0 - 0.09), (0.0, 0.0)] {
            let mut analysis = VarianceAnalysis::default();
            for sign in [1.0, -1.0] {
                let mut cluster = Cluster::default();
                for noise in [0.3, 0.0, -0.3] {
                    cluster.add_residual(sign * mean + noise);
                    analysis.add_residual(sign * mean + noise);
                }
                analysis.add_cluster(cluster);
            }
            assert!((analysis.variance_within() - 0.09).abs() < 1e-6, "{analysis:?}");
            assert!((analysis.variance_between() - expected).abs() < 1e-6, "{analysis:?}");
        }
        assert!(Discrepancy::default().field_variance(&NoiseModel::INITIAL) <= 0.0);
    }
}
