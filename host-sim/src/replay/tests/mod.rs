//! A flight that was judged, changed in one thing: what is said of it then.

mod dead;
mod handed_over;
mod lost;
mod told;
mod told_to;

use std::sync::LazyLock;

use super::judge::{Asked, Judged, Verdict, judge};
use super::*;
use crate::log::csv::Unit;
use crate::log::write::{Recording, dataflash, turns};
use crate::log::{self, Flight};
use crate::world::WorldConfig;

/// A flight of turns that calibrates, its field of that instant; and what is said of it.
static FLOWN: LazyLock<(Flight, Verdict)> = LazyLock::new(|| {
    let recording = Recording { place: None, ..turns(&WorldConfig::table1(1), 0.0) };
    let flight = log::read(&mut dataflash(&recording).as_slice(), Unit::Milligauss).unwrap();
    let asked = Asked { age_s: Some(0.0), ..Asked::OF_THE_LOG };
    let verdict = judge(&flight, &asked);
    (flight, verdict)
});

/// That flight, and its one compass.
fn flown() -> (Flight, Judged) {
    let (flight, verdict) = FLOWN.clone();
    let compass = verdict.compasses[0].clone();
    assert_eq!(compass.module.accepted, Ok(()));
    (flight, compass)
}

/// What is said of these compasses of it.
fn verdict(compasses: Vec<Judged>) -> Verdict {
    Verdict { compasses, ..FLOWN.1.clone() }
}

/// One that nobody could make anything of.
const REFUSED: Result<(), Refused> = Err(Refused::Solve(SolveError::NotConverged));
