//! Search for a load with a constant period in the residual field.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector3};

use crate::numbers::{mean, median};
use crate::replay::row::{ReplayRow, integrals};

/// Shortest and longest period, seconds.
const PERIODS_S: [f64; 2] = [0.2, 60.0];

/// Longest part of a flight that is transformed at once, seconds; and shortest, in longest periods that it shows.
const MAX_SEGMENT_S: f64 = 200.0;
const MIN_SEGMENT_S: f64 = 40.0;
const MIN_PERIODS_PER_SEGMENT: f64 = 4.0;

/// Longest interval between rows of a segment, seconds.
const MAX_GAP_S: f64 = 2.0;

/// Largest number of rows that are transformed, to bound the time.
const MAX_ROWS: usize = 12_000;

/// Fewest rows in a period: below two it is aliased.
const MIN_ROWS_PER_PERIOD: f64 = 2.1;

/// Frequencies on each side whose median is the background, and those next to the line that are left out.
const BACKGROUND_BINS: usize = 40;
const LINE_BINS: usize = 6;

/// A spectral line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpectralLine {
    pub period_s: f64,
    /// Amplitude, microtesla.
    pub amplitude_ut: Vector3<f64>,
    /// Standard deviations of a normal distribution, corrected for the number of frequencies.
    pub sigmas: f64,
}

/// Real and imaginary part of three signals at a frequency.
type Transform = [Vector3<f64>; 2];

/// Indices of the rows of a part of the flight without gaps.
type Segment = RangeInclusive<usize>;

/// The strongest significant line of the residuals that no motion of the aircraft shows.
pub(super) fn find_line(
    rows: &[ReplayRow],
    residuals: &[f64],
    directions: &[Vector3<f64>],
    min_sigmas: f64,
) -> Option<SpectralLine> {
    let segments = segments(rows);
    let shortest_s = segments.iter().map(|part| duration_s(rows, part)).reduce(f64::min)?;
    let row_interval_s = median(rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s));
    let longest_s = PERIODS_S[1].min(shortest_s / MIN_PERIODS_PER_SEGMENT);
    let shortest_period_s = PERIODS_S[0].max(MIN_ROWS_PER_PERIOD * row_interval_s);
    let step_hz = 0.5 / shortest_s;
    let step_count = ((shortest_period_s.recip() - longest_s.recip()) / step_hz) as u32;
    let frequencies_hz: Vec<f64> = (0..step_count).map(|i| longest_s.recip() + f64::from(i) * step_hz).collect();
    let signal = |i: usize| directions[2 * i] * residuals[2 * i] + directions[2 * i + 1] * residuals[2 * i + 1];
    let weights: Vec<Matrix3<f64>> =
        segments.iter().map(|part| inverse_weight(directions, part)).collect::<Option<_>>()?;
    let transforms: Vec<Vec<Transform>> =
        segments.iter().map(|part| transform(rows, part, &signal, &frequencies_hz)).collect();
    let powers: Vec<f64> = (0..frequencies_hz.len())
        .map(|at| {
            let of_segment = |(part, weight): (&Vec<Transform>, &Matrix3<f64>)| power(&part[at], weight);
            transforms.iter().zip(&weights).map(of_segment).sum()
        })
        .collect();
    let freedom = 6.0 * segments.len() as f64;
    let motions = motion_signals(rows)?;
    let count = frequencies_hz.len() as f64;
    let sigmas = |at: usize| corrected_sigmas(line_sigmas(&powers, at, freedom), count);
    let mut lines: Vec<usize> = (0..powers.len()).filter(|at| sigmas(*at) >= min_sigmas).collect();
    lines.sort_by(|one, other| powers[*other].total_cmp(&powers[*one]));
    let is_motion = |at: usize| {
        motions.iter().any(|signal| {
            let (powers, nearest) = scalar_powers(rows, &segments, signal, &frequencies_hz, at);
            line_sigmas(&powers, nearest, 2.0 * segments.len() as f64) > MOTION_LINE_SIGMAS
        })
    };
    let at = lines.into_iter().take(MAX_TRIED_LINES).find(|at| !is_motion(*at))?;
    let amplitudes = transforms.iter().zip(&weights).map(|(part, weight)| part[at].map(|part| weight * part));
    let mean_squares = amplitudes.fold(Vector3::zeros(), |sum: Vector3<f64>, [real, imaginary]| {
        sum + real.component_mul(&real) + imaginary.component_mul(&imaginary)
    }) / segments.len() as f64;
    Some(SpectralLine {
        period_s: frequencies_hz[at].recip(),
        amplitude_ut: mean_squares.map(f64::sqrt),
        sigmas: sigmas(at),
    })
}

/// Largest number of lines that are compared with the motions.
const MAX_TRIED_LINES: usize = 20;

/// Significance of a motion's line at which a line of the field there is that of the motion.
const MOTION_LINE_SIGMAS: f64 = 3.5;

/// Standard deviations that remain after `count` trials: the tail of a normal distribution falls as `exp(-z^2 / 2)`.
pub(super) fn corrected_sigmas(sigmas: f64, count: f64) -> f64 {
    let squared = sigmas * sigmas.max(0.0) - 2.0 * libm::log(count.max(1.0));
    squared.max(0.0).sqrt()
}

/// Parts of the flight without gaps, evenly chosen if there are many.
fn segments(rows: &[ReplayRow]) -> Vec<Segment> {
    let mut found: Vec<Segment> = Vec::new();
    let mut first = 0;
    for last in 0..rows.len() {
        let ends = rows
            .get(last + 1)
            .is_none_or(|next| next.t_s - rows[last].t_s > MAX_GAP_S || next.t_s - rows[first].t_s > MAX_SEGMENT_S);
        if ends {
            found.push(first..=last);
            first = last + 1;
        }
    }
    // Short remainders would limit the period of all.
    let longest_s = found.iter().map(|part| duration_s(rows, part)).fold(0.0, f64::max);
    found.retain(|part| duration_s(rows, part) >= MIN_SEGMENT_S.max(longest_s / 2.0));
    let row_count: usize = found.iter().map(|part| part.clone().count()).sum();
    let stride = row_count.div_ceil(MAX_ROWS).max(1);
    found.into_iter().step_by(stride).collect()
}

fn duration_s(rows: &[ReplayRow], part: &Segment) -> f64 {
    rows[*part.end()].t_s - rows[*part.start()].t_s
}

/// Inverse of the normal matrix of one phase of a sine.
fn inverse_weight(directions: &[Vector3<f64>], part: &Segment) -> Option<Matrix3<f64>> {
    let sum: Matrix3<f64> = directions[2 * part.start()..=2 * part.end() + 1]
        .iter()
        .map(|direction| direction * direction.transpose())
        .sum();
    let floor = sum.trace() * 1e-3;
    (sum / 2.0 + Matrix3::identity() * floor).try_inverse()
}

fn transform(
    rows: &[ReplayRow],
    part: &Segment,
    signal: &dyn Fn(usize) -> Vector3<f64>,
    frequencies_hz: &[f64],
) -> Vec<Transform> {
    let mut sums = vec![[Vector3::zeros(); 2]; frequencies_hz.len()];
    let Some(first_hz) = frequencies_hz.first() else { return sums };
    let step_hz = frequencies_hz.get(1).map_or(0.0, |second_hz| second_hz - first_hz);
    let duration_s = duration_s(rows, part);
    for i in part.clone() {
        let t_s = rows[i].t_s - rows[*part.start()].t_s;
        let value = signal(i) * (1.0 - libm::cos(TAU * t_s / duration_s));
        let (mut sin, mut cos) = libm::sincos(TAU * first_hz * t_s);
        let (step_sin, step_cos) = libm::sincos(TAU * step_hz * t_s);
        for [real, imaginary] in &mut sums {
            *real += value * cos;
            *imaginary += value * sin;
            (sin, cos) = (sin * step_cos + cos * step_sin, cos * step_cos - sin * step_sin);
        }
    }
    sums
}

fn power([real, imaginary]: &Transform, weight: &Matrix3<f64>) -> f64 {
    real.dot(&(weight * real)) + imaginary.dot(&(weight * imaginary))
}

/// Significance of a power above the background, of a chi-square distribution (E. B. Wilson, M. M. Hilferty, Proceedings of
/// the National Academy of Sciences 17, 1931). The background is the larger median of both sides: in a spectrum that falls
/// steeply, the power of its lower side is no line.
fn line_sigmas(powers: &[f64], at: usize, freedom: f64) -> f64 {
    let below = at.saturating_sub(BACKGROUND_BINS)..at.saturating_sub(LINE_BINS);
    let above = (at + LINE_BINS + 1).min(powers.len())..(at + BACKGROUND_BINS + 1).min(powers.len());
    let background =
        [below, above].into_iter().map(|side| median(powers[side].iter().copied())).fold(f64::NAN, f64::max);
    let width = 2.0 / (9.0 * freedom);
    // The median of the distribution is at (1 - width)^3 of its mean.
    (libm::cbrt(powers[at] / background) - 1.0) * (1.0 - width) / width.sqrt()
}

/// Signals of the aircraft's motion: attitude, turn rate, and four harmonics of the heading by the body rates, since the
/// field's own heading contains the load. None without body rates.
fn motion_signals(rows: &[ReplayRow]) -> Option<Vec<Vec<f64>>> {
    let turn_rates: Vec<f64> = rows.iter().map(ReplayRow::heading_rate_rad_s).collect::<Option<_>>()?;
    let headings_rad = integrals(rows, |row| row.heading_rate_rad_s().unwrap_or(0.0));
    let mut signals: Vec<Vec<f64>> = vec![
        rows.iter().map(|row| f64::from(row.attitude.roll_rad)).collect(),
        rows.iter().map(|row| f64::from(row.attitude.pitch_rad)).collect(),
        turn_rates,
    ];
    for harmonic in 1..=4 {
        let phase = |heading_rad: &f64| f64::from(harmonic) * heading_rad;
        signals.push(headings_rad.iter().map(|heading_rad| libm::cos(phase(heading_rad))).collect());
        signals.push(headings_rad.iter().map(|heading_rad| libm::sin(phase(heading_rad))).collect());
    }
    Some(signals)
}

/// Powers of a signal around a frequency, and the index of the largest next to it.
fn scalar_powers(
    rows: &[ReplayRow],
    segments: &[Segment],
    signal: &[f64],
    frequencies_hz: &[f64],
    at: usize,
) -> (Vec<f64>, usize) {
    let from = at.saturating_sub(BACKGROUND_BINS + LINE_BINS);
    let to = (at + BACKGROUND_BINS + LINE_BINS + 1).min(frequencies_hz.len());
    let mean = mean(signal.iter().copied());
    let mut powers = vec![0.0; to - from];
    for part in segments {
        let value = |i: usize| Vector3::new(signal[i] - mean, 0.0, 0.0);
        for (sum, [real, imaginary]) in powers.iter_mut().zip(transform(rows, part, &value, &frequencies_hz[from..to]))
        {
            *sum += real.x * real.x + imaginary.x * imaginary.x;
        }
    }
    let near = (at - from).saturating_sub(2)..(at - from + 3).min(powers.len());
    let largest = near.max_by(|a, b| powers[*a].total_cmp(&powers[*b])).unwrap_or(at - from);
    (powers, largest)
}
