//! Inputs and results of a replay.

use autoswing::calibration::Solution;
use autoswing::earth::{Date, EarthField, Position};
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing_module::messages::Refusal;
use serde::{Deserialize, Serialize};

/// Rows used for the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowSelection {
    /// All usable rows, evenly thinned to the device's capacity.
    All,
    /// Samples kept by the device's turn procedure.
    Turns,
    /// Samples kept by the device in any flight, until it ends the collection.
    Flight,
}

/// Prior information on the Earth field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EarthFieldPrior {
    /// Configured inclination of the Earth field, degrees.
    pub inclination_deg: Option<f64>,
    /// Place and day for the field model, used if no inclination is configured and dropped if the samples contradict
    /// it.
    pub place_and_day: Option<(Position, Date)>,
}

impl EarthFieldPrior {
    /// Configured inclination, else that of the field model, radians.
    pub(super) fn inclination_rad(&self) -> Option<f32> {
        let by_model = || {
            let (position, day) = self.place_and_day?;
            Some(EarthField::from_model(position, day)?.inclination_deg)
        };
        self.inclination_deg.map(|inclination_deg| inclination_deg as f32).or_else(by_model).map(f32::to_radians)
    }
}

/// Heading of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingRow {
    /// Flight time of the row, seconds.
    pub t_s: f64,
    /// Magnetic heading of the row by the solution, degrees.
    pub heading_deg: f64,
    /// Standard deviation of the heading, degrees.
    pub sigma_deg: f64,
    /// Smoothed heading and its standard deviation, degrees, if available.
    pub smoothed_and_sigma_deg: Option<[f64; 2]>,
    /// Whether the module would have sent the heading, or why not.
    pub status: Result<(), NoHeading>,
}

impl HeadingRow {
    /// Combines a heading estimated at any field strength with the module's status.
    pub(super) fn from_estimate(t_s: f64, estimate: &Estimate, status: Result<(), NoHeading>) -> Self {
        let degrees = |heading: Heading| [heading.magnetic_deg(), heading.sigma_deg()].map(f64::from);
        let [heading_deg, sigma_deg] = estimate.heading.map_or([f64::NAN; 2], degrees);
        Self { t_s, heading_deg, sigma_deg, smoothed_and_sigma_deg: estimate.smoothed_heading.map(degrees), status }
    }

    /// Heading and standard deviation sent by the module, degrees.
    pub(super) fn sent_and_sigma_deg(&self) -> [f64; 2] {
        self.smoothed_and_sigma_deg.unwrap_or([self.heading_deg, self.sigma_deg])
    }
}

/// Heading error over usable rows with a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingScore {
    /// RMS heading error less mean, degrees.
    pub rms_deg: f64,
    /// Mean heading error, degrees; includes the declination if the reference is true.
    pub mean_deg: f64,
    /// Number of rows that are scored.
    pub row_count: usize,
    /// Percentage of demeaned errors within one and two standard deviations.
    pub within_sigmas_percent: [f64; 2],
}

/// Outcome of a calibration by the rows of a log.
#[derive(Clone, Debug)]
pub struct CalibrationOutcome {
    /// The solution, if any.
    pub solution: Option<Solution>,
    /// Whether the module would have accepted the solution; otherwise the reason, with what the flight lacked.
    pub acceptance: Result<(), Refusal>,
    /// Number of fitted samples.
    pub fitted_count: usize,
    /// Time of the automatic end, seconds after the first row.
    pub collection_end_s: Option<f64>,
}

/// Result of a replay.
#[derive(Clone, Debug)]
pub struct ReplayResult {
    /// Outcome of the calibration.
    pub outcome: CalibrationOutcome,
    /// Headings, one for each row; empty without a solution.
    pub headings: Vec<HeadingRow>,
    /// Score of the heading, with a reference.
    pub score: Option<HeadingScore>,
    /// Score of the heading sent, smoothed if available.
    pub smoothed_score: Option<HeadingScore>,
}
