//! A flight recorded in the simulator, replayed: the answer is that of the module, whichever rows are used.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

mod course;
mod native;
mod rows;

use host_sim::log::csv::Unit;
use host_sim::log::{self, Flight};
use host_sim::replay::judge::Asked;

/// How a native log is judged.
const ASKED: Asked = Asked::OF_THE_LOG;

fn read(bytes: &[u8]) -> Flight {
    let mut source = bytes;
    log::read(&mut source, Unit::Milligauss).unwrap()
}
