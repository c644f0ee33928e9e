//! Reads samples from a CSV file, solves for the calibration, and prints the heading of each sample:
//!
//! ```sh
//! cargo run -p autoswing --example headings -- host-sim/data/flight.csv
//! ```
//!
//! The first six columns are those of `calibrate::sample`. `examples/no_std.rs` builds the same code without `std`.

mod calibrate;

use std::error::Error;

use autoswing::calibration::Sample;

/// Reads samples from CSV; ignores lines that do not start with six numbers, such as the header.
fn samples_of_csv(csv: &str) -> Vec<Sample> {
    let numbers = |line: &str| line.split(',').take(6).map(|cell| cell.trim().parse()).collect::<Result<Vec<f32>, _>>();
    csv.lines().filter_map(|line| numbers(line).ok()?.try_into().ok()).map(calibrate::sample).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: headings FILE.csv")?;
    let samples = samples_of_csv(&std::fs::read_to_string(path)?);
    let solution = calibrate::calibrate(&samples).map_err(|error| error.to_string())?;
    println!("expected error {:.2} deg RMS, {} samples", solution.quality.expected_rms_deg, samples.len());
    for sample in &samples {
        match calibrate::heading_deg(&solution, sample) {
            Ok([heading_deg, sigma_deg]) => println!("{heading_deg:.1} deg, sigma {sigma_deg:.1} deg"),
            Err(reason) => println!("no heading: {}", reason.stable_code()),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLIGHT_CSV: &str = include_str!("../../../../host-sim/data/flight.csv");

    /// Declination of the flight (WMM2025), degrees: reference headings are true.
    const DECLINATION_DEG: f32 = -4.2;

    /// The RMS heading error stays below twice the expected error; measured: 0.4 deg.
    #[test]
    fn headings_are_as_accurate_as_expected() {
        let true_deg: Vec<f32> = FLIGHT_CSV.lines().filter_map(|line| line.split(',').nth(6)?.parse().ok()).collect();
        let samples = samples_of_csv(FLIGHT_CSV);
        assert_eq!((samples.len(), true_deg.len()), (1000, 1000));
        let solution = calibrate::calibrate(&samples).unwrap();
        let squares = samples.iter().zip(&true_deg).map(|(sample, true_deg)| {
            let [heading_deg, _] = calibrate::heading_deg(&solution, sample).unwrap();
            let error_deg = (heading_deg + DECLINATION_DEG - true_deg + 540.0).rem_euclid(360.0) - 180.0;
            error_deg * error_deg
        });
        let rms_deg = (squares.sum::<f32>() / samples.len() as f32).sqrt();
        assert!(solution.quality.expected_rms_deg < 0.5, "{:?}", solution.quality);
        assert!(rms_deg < 2.0 * solution.quality.expected_rms_deg, "{rms_deg} deg RMS");
    }
}
