//! Stationary coloured noise (Gauss-Markov processes).

use crate::random::RandomStream;

/// First-order Gauss-Markov process with exponential autocorrelation; not differentiable.
#[derive(Clone, Debug)]
pub struct FirstOrderProcess {
    value: f64,
    decay: f64,
    input_gain: f64,
    random: RandomStream,
}

impl FirstOrderProcess {
    /// A stationary process with this standard deviation and correlation time, sampled every `step_s`.
    #[must_use]
    pub fn new(sigma: f64, correlation_s: f64, step_s: f64, mut random: RandomStream) -> Self {
        let decay = libm::exp(-step_s / correlation_s);
        Self { value: sigma * random.gaussian(), decay, input_gain: sigma * (1.0 - decay * decay).sqrt(), random }
    }

    /// Next sample of the process.
    pub fn next_value(&mut self) -> f64 {
        self.value = self.decay * self.value + self.input_gain * self.random.gaussian();
        self.value
    }
}

/// Critically damped second-order Gauss-Markov process; differentiable, as the motion of a mass.
#[derive(Clone, Debug)]
pub struct SecondOrderProcess {
    value: f64,
    input: FirstOrderProcess,
    decay: f64,
}

impl SecondOrderProcess {
    /// A stationary process with this standard deviation and integral correlation time, sampled every `step_s`.
    ///
    /// It is a first-order process followed by a first-order lag, both with half the correlation time. With the decay
    /// `a` per step, an input variance of `s^2` gives an output variance of `s^2 (1 + a^2) / (1 + a)^2`.
    #[must_use]
    pub fn new(sigma: f64, correlation_s: f64, step_s: f64, mut random: RandomStream) -> Self {
        let time_constant_s = correlation_s / 2.0;
        let decay = libm::exp(-step_s / time_constant_s);
        let input_sigma = sigma * (1.0 + decay) / (1.0 + decay * decay).sqrt();
        let value = sigma * random.gaussian();
        Self { value, input: FirstOrderProcess::new(input_sigma, time_constant_s, step_s, random), decay }
    }

    /// Next sample of the process.
    pub fn next_value(&mut self) -> f64 {
        self.value = self.decay * self.value + (1.0 - self.decay) * self.input.next_value();
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    const STEP_S: f64 = 0.01;

    /// Standard deviation and integral of the autocorrelation over 8 correlation times.
    fn sigma_and_correlation_time(mut next_value: impl FnMut() -> f64, correlation_s: f64) -> (f64, f64) {
        let values: Vec<f64> = (0..2_000_000).map(|_| next_value()).collect();
        let covariance = |lag: usize| {
            let pairs = values.len() - lag;
            values.iter().zip(&values[lag..]).map(|(a, b)| a * b).sum::<f64>() / pairs as f64
        };
        let variance = covariance(0);
        let lag_step = 10;
        let lags = (8.0 * correlation_s / STEP_S) as usize;
        let area: f64 = (lag_step..lags).step_by(lag_step).map(covariance).sum::<f64>() + variance / 2.0;
        (variance.sqrt(), area / variance * STEP_S * lag_step as f64)
    }

    /// 20,000 s are 13,000 correlation times of 1.5 s: sigma is accurate to 1 %, the integral to about 5 %.
    #[test]
    fn both_processes_have_their_standard_deviation_and_correlation_time() {
        let random = || RandomStream::new(1, StreamPurpose::Bank);
        let mut rough = FirstOrderProcess::new(2.0, 1.5, STEP_S, random());
        let mut smooth = SecondOrderProcess::new(2.0, 1.5, STEP_S, random());
        for (sigma, correlation_s) in [
            sigma_and_correlation_time(|| rough.next_value(), 1.5),
            sigma_and_correlation_time(|| smooth.next_value(), 1.5),
        ] {
            assert!((sigma - 2.0).abs() < 0.06, "sigma {sigma}");
            assert!((correlation_s - 1.5).abs() < 0.2, "correlation time {correlation_s}");
        }
    }
}
