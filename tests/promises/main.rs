//! The product's promises, one module for each subject: the whole module flies in the simulator, logs of such flights are
//! judged, and the commands run as processes.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

mod accuracy;
mod architecture;
mod automatic;
mod autopilot_filter;
mod autopilot_view;
mod can;
#[cfg(unix)]
mod commands;
mod consistency;
mod console;
mod fixtures;
mod ground;
mod integrity;
mod links;
mod magnetometer;
mod mission;
mod own_attitude;
mod persistence;
mod ports;
mod refusals;
mod replay;
mod report;
mod routines;
#[cfg(unix)]
mod serve;
mod stream;
mod table1;
