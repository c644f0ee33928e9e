//! Verdict on a flight, which the terminal, the page and `--json` show: on each compass as the aircraft flies it, the
//! one in use first; and, where a module is compared, whether it would have calibrated itself.

mod facts;
mod flight_verdict;
mod json;
mod judgement;

pub use flight_verdict::{CompassVerdict, Verdict};
pub use judgement::{CompassAction, CompassState};
