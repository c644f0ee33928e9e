//! `lab emulate`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use crate::emulator::{self, Emulator, EmulatorError};
use clap::Args;
use host_sim::command_failure::CommandFailure;
use host_sim::fly::{FlyOptions, RecordedMission};
use host_sim::termination::{SecondSignal, TerminationSignals};
use simulator::devices::sensor::SensorModel;

/// Fly the mission with the firmware as ARM code, in QEMU.
///
/// QEMU's mps2-an386 is a Cortex-M4F with QEMU's own magnetometer.
///
/// Needs qemu-system-arm and the image from scripts/build-firmware. World and machine run in lockstep, so the result
/// depends on the seed only, except for a microsecond at a restart. It takes a minute or two.
#[derive(Debug, Args)]
pub struct EmulateOptions {
    #[command(flatten)]
    fly: FlyOptions,
    /// Firmware image [default: target/firmware/mps2-an386.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

pub fn run_emulate(options: &EmulateOptions) -> Result<ExitCode, CommandFailure> {
    if options.fly.sensor != SensorModel::default() {
        return Err(CommandFailure("--sensor: QEMU has a magnetometer of its own".to_owned()));
    }
    let image = options.image.clone().unwrap_or_else(emulator::default_image);
    let failed = |error: EmulatorError| CommandFailure(format!("{}: {error}", error.stable_code()));
    let interruption = TerminationSignals::install_handlers(SecondSignal::IsIgnored)?;
    let mission = Emulator::start_with(
        &image,
        options.fly.world_config()?,
        Emulator::SENDING_AUTOPILOT,
        Arc::clone(interruption.stop_flag()),
    )
    .and_then(|mut emulator| {
        let mission = RecordedMission::fly(&mut emulator, &options.fly);
        emulator.take_failure().map_or(Ok(mission), Err)
    });
    match interruption.exit_code() {
        Some(code) => Ok(code),
        None => mission.map_err(failed)?.report(&options.fly),
    }
}
