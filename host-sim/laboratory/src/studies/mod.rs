//! Studies: accuracy and integrity of headings in many random flights, and the experiment of the paper.
//!
//! | module | holds |
//! |---|---|
//! | [`accuracy`] | accuracy relative to the Cramér-Rao bound |
//! | [`imu`] | attitude and heading on recorded trials of an inertial sensor |
//! | [`integrity`] | headings output as good while a fault is active |
//! | [`paper_experiment`] | reproduction of Liu 2007 table 1 with every method |

pub mod accuracy;
pub mod imu;
pub mod integrity;
pub mod paper_experiment;
