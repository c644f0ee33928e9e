//! Main loop of a served module.

use std::fs::File;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use std::{io, thread};

use host_sim::command_failure::CommandFailure;
use host_sim::print;

use super::byte_connections::{ByteConnection, MAX_POLL_BYTES, POLL_INTERVAL, read_in_thread};
use super::can::MulticastBus;
use crate::serve::{FlashImage, FlashImageError, PORTS, ServedModule};

pub struct Connections {
    /// Connections to each of the module's ports, by port.
    pub port_wires: Vec<Vec<Box<dyn ByteConnection>>>,
    pub attitude_socket: Option<UdpSocket>,
    pub can_bus: Option<MulticastBus>,
    pub pilot_commands: PilotCommandInput,
    pub flash_writer: FlashWriter,
}

/// Largest number of datagrams read in one poll; the system's buffer drops the excess.
const MAX_DATAGRAMS_PER_POLL: usize = 64;

impl Connections {
    /// Runs the served module until stopped, or until the reader has closed standard output.
    pub fn run_connections(
        mut self,
        served_module: &mut ServedModule,
        speed: f64,
        stop: &AtomicBool,
    ) -> Result<(), CommandFailure> {
        // Absent from the first step of an external simulator on, which then drives the module's clock.
        let mut virtual_clock = Some(VirtualClock::new(speed));
        let mut is_malformed_reported = false;
        while !stop.load(Ordering::SeqCst) && !print::poll_output_closed() {
            // Time advances before inputs are read, so that an input takes effect after it was received.
            served_module.advance_time(virtual_clock.as_mut().map_or(0, VirtualClock::elapsed_us));
            // Bytes that a simulator sent before its step are read after it, and so are with the module in that step.
            let mut step = None;
            if let Some(world) = &self.attitude_socket {
                step = apply_datagrams(world, served_module, &mut is_malformed_reported);
            }
            for (port, wires) in self.port_wires.iter_mut().enumerate() {
                for wire in wires {
                    // At most as many bytes are read as the port can receive: a faster sender waits, as on a real line.
                    let bytes = wire.read_bytes(served_module.free_bytes(port).min(MAX_POLL_BYTES));
                    served_module.send_bytes(port, &bytes);
                    for notice in wire.take_notices() {
                        print::print_error(format_args!("{}: {notice}", PORTS[port].port_name));
                    }
                }
            }
            self.pilot_commands.execute_pilot_lines(served_module);
            if let Some(can) = &self.can_bus {
                can.receive_frames().iter().for_each(|frame| served_module.send_frame_to_module(frame));
            }
            if let Some(Step { step_us, .. }) = step {
                virtual_clock = None;
                served_module.advance_time(step_us);
            }
            if let Some(can) = &self.can_bus {
                served_module.take_module_frames().iter().for_each(|frame| can.send_frame(frame));
            }
            if let Some((path, server)) = served_module.take_firmware_update() {
                print::print_error(format_args!(
                    "firmware update: {path} of node {server}; a simulated module has no boot loader, and restarts"
                ));
            }
            for (port, wires) in self.port_wires.iter_mut().enumerate() {
                let bytes = served_module.receive_bytes(port);
                for wire in wires {
                    wire.write_bytes(&bytes);
                }
            }
            if let (Some(Step { sender, .. }), Some(world)) = (step, &self.attitude_socket) {
                // Without an answer the simulator waits, as for any lost datagram.
                let _ = world.send_to(format!("{}", served_module.now_us() as f64 / 1e6).as_bytes(), sender);
            }
            if let Some(error_text) = virtual_clock.as_mut().and_then(VirtualClock::take_warning) {
                print::print_error(error_text);
            }
            self.flash_writer.write_if_stable(served_module, false)?;
            thread::sleep(POLL_INTERVAL);
        }
        self.flash_writer.write_if_stable(served_module, true)
    }
}

/// Step of an external simulator that drives the module's clock.
#[derive(Clone, Copy)]
struct Step {
    step_us: u64,
    sender: SocketAddr,
}

/// Applies received attitudes and reports the first malformed one; returns their steps in sum.
fn apply_datagrams(world: &UdpSocket, served_module: &mut ServedModule, is_reported: &mut bool) -> Option<Step> {
    let mut datagram = [0; 256];
    let mut sum: Option<Step> = None;
    for _ in 0..MAX_DATAGRAMS_PER_POLL {
        let Ok((length, sender)) = world.recv_from(&mut datagram) else { break };
        match served_module.follow_datagram(&datagram[..length]) {
            Ok(Some(step_us)) => sum = Some(Step { step_us: step_us + sum.map_or(0, |sum| sum.step_us), sender }),
            Err(error) if !*is_reported => {
                print::print_error(format_args!(
                    "error {}: {error}; more of them are only counted, see status",
                    error.stable_code()
                ));
                *is_reported = true;
            }
            Ok(None) | Err(_) => {}
        }
    }
    sum
}

pub struct PilotCommandInput {
    byte_receiver: Receiver<Vec<u8>>,
    unfinished_line: Vec<u8>,
}

/// Largest length of an order, bytes.
const MAX_LINE_BYTES: usize = 256;

impl PilotCommandInput {
    pub fn from_stdin() -> Self {
        Self { byte_receiver: read_in_thread(io::stdin()), unfinished_line: Vec::new() }
    }

    fn execute_pilot_lines(&mut self, served_module: &mut ServedModule) {
        while let Ok(bytes) = self.byte_receiver.try_recv() {
            for byte in bytes {
                if byte == b'\n' {
                    execute_and_answer(served_module, &std::mem::take(&mut self.unfinished_line));
                } else if self.unfinished_line.len() <= MAX_LINE_BYTES {
                    self.unfinished_line.push(byte);
                }
            }
        }
    }
}

fn execute_and_answer(served_module: &mut ServedModule, line: &[u8]) {
    let line = String::from_utf8_lossy(line);
    if line.len() > MAX_LINE_BYTES {
        print::print_line("error line-too-long: an order has at most 256 characters");
    } else if !line.trim().is_empty() {
        let answer = served_module
            .execute_pilot_line(&line)
            .unwrap_or_else(|error| format!("error {}: {error}", error.stable_code()));
        print::print_line(answer);
    }
}

/// Longest lag of virtual time that is caught up; a longer one means that the computer slept or is overloaded.
const MAX_CATCH_UP: Duration = Duration::from_millis(250);

pub struct VirtualClock {
    speed: f64,
    last_call: Instant,
    /// Wall time that was not caught up.
    skipped_time: Duration,
    has_warned: bool,
}

impl VirtualClock {
    pub fn new(speed: f64) -> Self {
        Self { speed, last_call: Instant::now(), skipped_time: Duration::ZERO, has_warned: false }
    }

    /// Virtual time since the last call, microseconds.
    pub fn elapsed_us(&mut self) -> u64 {
        let now = Instant::now();
        let passed = now - self.last_call;
        self.last_call = now;
        self.skipped_time += passed.saturating_sub(MAX_CATCH_UP);
        (passed.min(MAX_CATCH_UP).as_secs_f64() * self.speed * 1e6) as u64
    }

    /// A warning, returned once, if the computer is too slow.
    pub fn take_warning(&mut self) -> Option<String> {
        let is_new = self.skipped_time > Duration::from_secs(2) && !self.has_warned;
        self.has_warned |= is_new;
        is_new.then(|| format!("note: this computer does not keep up with --speed {}; it goes on slower", self.speed))
    }
}

/// Writes the flash to its file after each change, and keeps the file locked.
#[derive(Default)]
pub struct FlashWriter {
    path: Option<PathBuf>,
    locked_file: Option<File>,
    written_change_count: u64,
    seen_change_count: u64,
}

impl FlashWriter {
    /// Locks and reads a file.
    pub fn open_file(path: Option<&Path>) -> Result<(Self, Option<FlashImage>), CommandFailure> {
        let (locked_file, image) =
            path.map(FlashImage::lock_and_read).transpose().map_err(flash_failure)?.flatten().unzip();
        Ok((Self { path: path.map(Path::to_owned), locked_file, ..Self::default() }, image))
    }

    /// Writes the module's flash contents to the file.
    pub fn write_flash(&mut self, served_module: &ServedModule) -> Result<(), CommandFailure> {
        if let Some(path) = &self.path {
            if cfg!(windows) {
                // Windows cannot replace an open file, so the locked file is closed first.
                self.locked_file = None;
            }
            self.locked_file = Some(served_module.flash_image().write_file(path).map_err(flash_failure)?);
        }
        Ok(())
    }

    /// Writes the file if the flash changed and is stable since the last call, or at the end.
    pub fn write_if_stable(&mut self, served_module: &ServedModule, is_end: bool) -> Result<(), CommandFailure> {
        let changes = served_module.flash_change_count();
        let is_stable = changes == self.seen_change_count || is_end;
        self.seen_change_count = changes;
        if is_stable && changes != self.written_change_count {
            self.write_flash(served_module)?;
            self.written_change_count = changes;
        }
        Ok(())
    }
}

fn flash_failure(error: FlashImageError) -> CommandFailure {
    CommandFailure::with_code(error.stable_code(), error)
}
