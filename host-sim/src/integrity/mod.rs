//! Integrity: what the module believes while something is wrong.
//!
//! Each [`Case`] is a fault, in use after a clean calibration or during the calibration. Seeded random airframes at
//! random places fly it with the firmware's own tasks ([`flight`]); what is counted is how much of what was sent as good
//! was not ([`Tally`]). The truth is the simulator's own mathematics.

pub mod case;
pub mod flight;
mod tally;
mod usage;

use autoswing::settings::HeadingKind;
use rayon::prelude::*;
use serde::Serialize;

pub use case::{CASES, Case};
pub use tally::Tally;

use flight::{Calibrated, Flown, IronError};

use crate::world::aircraft::Kind;
use crate::world::far_end::FarEnd;
use crate::world::msp_autopilot::{self, Troubles};

/// How large a run is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Flights of each case.
    pub flights: u64,
    /// Seed of the first flight; the others follow.
    pub seed: u64,
    /// Which heading the pilot has sent.
    pub heading: HeadingKind,
    /// What flies.
    pub aircraft: Kind,
    /// What the attitude comes by.
    pub source: Source,
}

/// What the attitude comes by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// An autopilot that sends MAVLink, with body rates.
    #[default]
    Mavlink,
    /// ArduPilot by MSP: it is asked for the attitude, which comes in tenths of a degree and without rates.
    Msp,
}

impl Source {
    /// Who is at the autopilot's port.
    const fn far_end(self) -> FarEnd {
        match self {
            Self::Mavlink => FarEnd::Talker,
            Self::Msp => FarEnd::Msp(
                msp_autopilot::Firmware::ArduPilot,
                Troubles { dropped: 0.0, refused: 0.0, cut: 0.0, joined: 0.0 },
            ),
        }
    }
}

/// What came of all flights of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub case: &'static str,
    /// Flights flown.
    pub flights: usize,
    /// Calibrations accepted, of flights flown.
    pub accepted_percent: f64,
    /// Calibrations accepted whose true error was more than three times the expected one, of flights flown.
    pub wrong_percent: f64,
    /// Median of true over expected error of accepted calibrations; none if there are none.
    pub ratio_median: Option<f64>,
    /// The largest.
    pub ratio_worst: Option<f64>,
    /// Headings sent as good whose error was more than four sigmas and more than 5 deg, of all sent as good since the
    /// fault began.
    pub bad_percent: f64,
    /// The longest run of such headings, seconds.
    pub longest_bad_s: f64,
    /// Largest error of a heading sent as good, degrees.
    pub worst_deg: f64,
    /// Smooth headings, of those sent as good.
    pub smooth_percent: f64,
    /// RMS error of the headings sent as good, degrees.
    pub rms_deg: f64,
    /// Of them within one sigma.
    pub within_one_sigma_percent: f64,
    /// Within two.
    pub within_two_sigma_percent: f64,
    /// Within three.
    pub within_three_sigma_percent: f64,
    /// Sentences without a heading, of all since the fault began.
    pub empty_percent: f64,
    /// Times that headings ceased while no fault acted, an hour of such time.
    pub alarms_per_hour: f64,
    /// How far what is told of iron that moved is from what did, after a full turn each way, of its size; the median of
    /// the flights. None where none moves in use.
    pub iron_error_median_percent: Option<f64>,
    /// Why calibrations were refused, each code with its number, the most frequent first.
    pub refused: Vec<(String, usize)>,
    /// Why there were no headings since the fault began, each code with its number of sentences.
    pub empty: Vec<(String, usize)>,
}

/// Flies all cases, on all cores; `flown` is told of every flight that has ended. The result does not depend on the
/// number of cores.
pub fn run(plan: Plan, cases: &[&'static Case], flown: &(dyn Fn() + Sync)) -> Vec<Row> {
    let flights: Vec<(usize, u64)> = cases
        .iter()
        .enumerate()
        .flat_map(|(i, case)| (0..case.flights(plan.flights)).map(move |n| (i, plan.seed.wrapping_add(n))))
        .collect();
    let all: Vec<(usize, Flown)> = flights
        .into_par_iter()
        .map(|(i, seed)| {
            let one = (i, flight::fly(cases[i], seed, &plan));
            flown();
            one
        })
        .collect();
    let of = |i: usize| all.iter().filter(move |(case, _)| *case == i).map(|(_, flown)| flown);
    cases.iter().enumerate().map(|(i, case)| row(case.name, &of(i).collect::<Vec<_>>())).collect()
}

/// How many flights a run takes.
#[must_use]
pub fn flights(plan: Plan, cases: &[&'static Case]) -> u64 {
    cases.iter().map(|case| case.flights(plan.flights)).sum()
}

fn row(case: &'static str, flown: &[&Flown]) -> Row {
    let ratios = sorted(flown.iter().filter_map(|one| one.calibrated.as_ref().ok().map(Calibrated::ratio)));
    let iron_errors = sorted(flown.iter().filter_map(|one| one.iron.map(|IronError(error)| error)));
    let percent_of_flights = |number: usize| 100.0 * number as f64 / flown.len().max(1) as f64;
    let tally = flown.iter().fold(Tally::default(), |sum, one| sum.and(&one.tally));
    let [one, two, three] = tally.within_percent();
    Row {
        case,
        flights: flown.len(),
        accepted_percent: percent_of_flights(ratios.len()),
        wrong_percent: percent_of_flights(ratios.iter().filter(|&&ratio| ratio > 3.0).count()),
        ratio_median: median(&ratios),
        ratio_worst: ratios.last().copied(),
        bad_percent: tally.bad_percent(),
        longest_bad_s: tally.longest_bad_s,
        worst_deg: tally.worst_deg,
        smooth_percent: tally.smooth_percent(),
        rms_deg: tally.rms_deg(),
        within_one_sigma_percent: one,
        within_two_sigma_percent: two,
        within_three_sigma_percent: three,
        empty_percent: tally.empty_percent(),
        alarms_per_hour: tally.alarms_per_hour(),
        iron_error_median_percent: median(&iron_errors).map(|error| 100.0 * error),
        refused: counted(flown.iter().filter_map(|one| one.calibrated.as_ref().err().cloned())),
        empty: tally.empty.into_iter().collect(),
    }
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// Of numbers that are sorted.
fn median(sorted: &[f64]) -> Option<f64> {
    sorted.get(sorted.len() / 2).copied()
}

fn counted(codes: impl Iterator<Item = String>) -> Vec<(String, usize)> {
    let mut counts = std::collections::BTreeMap::new();
    for code in codes {
        *counts.entry(code).or_insert(0) += 1;
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, number)| std::cmp::Reverse(*number));
    counts
}
