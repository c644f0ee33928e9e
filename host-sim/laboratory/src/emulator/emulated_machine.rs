//! QEMU process with the firmware, and its connections.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use nalgebra::Vector3;
use serde_json::json;
use tempfile::TempDir;

use super::elf_header;
use super::error::{EmulatorError, QEMU_PROGRAM};
use super::qmp::{self, LocalStream, Qmp};

/// Ticks per microsecond of the firmware's clock.
pub const TICKS_PER_US: u64 = 25;

/// Nanoseconds per tick.
pub const TICK_NS: u64 = 1000 / TICKS_PER_US;

/// Duration of an instruction as a power of two (QEMU's `-icount shift`): 64 ns, five times slower than the reference
/// board at 80 MHz.
const ICOUNT_SHIFT: u32 = 6;
pub const INSTRUCTION_NS: u64 = 1 << ICOUNT_SHIFT;

/// Size of the PSRAM that simulates flash, bytes.
const FLASH_BYTES: usize = 16 << 20;

/// Host time after which a silent machine counts as hanging.
const REPLY_TIMEOUT: Duration = Duration::from_mins(1);

/// Poll period for start, end and stop requests.
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// Host time within which QEMU ends after closing a connection.
const EXIT_TIMEOUT: Duration = Duration::from_secs(2);

/// Offset in microtesla on x, y and z, because QEMU's sensor accepts only non-negative values. The firmware's board
/// file subtracts it.
const FIELD_OFFSET_UT: [f64; 3] = [93.0, 93.0, 104.0];
const NT_PER_UT: f64 = 1000.0;
/// Largest value that QEMU accepts at this gain: 2047 counts at 1100 and 980 counts per gauss.
const MAX_FIELD_NT: [f64; 3] = [186_000.0, 186_000.0, 208_800.0];

/// Message from the machine, which then waits for its input unless it has just started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MachineMessage {
    /// Message of a started firmware, which continues immediately.
    Started,
    /// A time step has passed.
    Step,
    /// The firmware is about to read the sensor.
    Sensor,
    /// The firmware has written to the instrument port.
    Written,
}

/// Input with which the machine continues.
#[derive(Clone, Debug, Default)]
pub struct StepInput {
    /// Bytes for console, autopilot port and instrument port.
    pub port_bytes: [Vec<u8>; 3],
    /// Whether the sensor's data wire is broken.
    pub is_sensor_wire_broken: bool,
    /// Test to be run by the bench image.
    pub bench_test: Option<BenchTest>,
}

impl StepInput {
    /// Last byte of the message: bit 0 breaks the sensor's wire, higher bits are the test number.
    fn step_flags(&self) -> u8 {
        u8::from(self.is_sensor_wire_broken) | self.bench_test.map_or(0, |test| test as u8) << 1
    }
}

/// Tests of the bench image; numbers as in its board file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BenchTest {
    /// Counts instructions and prints the counts on the console.
    Budgets = 1,
    /// Executes an undefined instruction.
    Fault = 2,
    /// Overflows the stack.
    Overflow = 3,
    /// Panics with a message of 200 characters.
    Panic = 4,
    /// Panics, now and at each later start.
    PanicAtStarts = 5,
}

/// Names of the machine's ports.
const PORT_NAMES: [&str; 3] = ["console", "autopilot port", "instrument port"];

/// Largest number of bytes per port and step.
pub const MAX_STEP_BYTES: usize = 255;

/// Running QEMU, ended on drop.
pub struct EmulatedMachine {
    qemu: Qemu,
    qmp: Qmp,
    ports: [LocalStream; 3],
    lockstep: LocalStream,
    /// Set by the caller to stop the machine.
    stop_flag: Arc<AtomicBool>,
    /// Directory of sockets and flash, removed on drop.
    _directory: TempDir,
}

impl EmulatedMachine {
    /// Starts QEMU with a firmware image and erased flash. Setting `stop_flag` cancels all waiting.
    pub fn start_qemu(image: &Path, stop_flag: Arc<AtomicBool>) -> Result<Self, EmulatorError> {
        if !qmp::ARE_LOCAL_SOCKETS_SUPPORTED {
            return Err(EmulatorError::NoLocalSockets);
        }
        elf_header::check_image(image)?;
        let directory = tempfile::tempdir().map_err(|error| EmulatorError::Connection("directory", error))?;
        let flash = directory.path().join("flash.bin");
        fs::write(&flash, vec![0xFF; FLASH_BYTES]).map_err(|error| EmulatorError::Connection("flash", error))?;
        let sockets = ["console", "autopilot", "lockstep", "instrument", "qmp"].map(|name| directory.path().join(name));
        let log = directory.path().join("log");
        let stderr = fs::File::create(&log).map_err(|error| EmulatorError::Connection("log", error))?;
        let child = qemu_command(image, &flash, &sockets).stderr(stderr).spawn().map_err(EmulatorError::NoQemu)?;
        let mut qemu = Qemu { child, log, stop_flag: Arc::clone(&stop_flag) };
        let [console, autopilot, lockstep, instrument, qmp] = &sockets;
        let mut connect_port = |index: usize, socket| -> Result<LocalStream, EmulatorError> {
            let stream = qemu.connect_socket(PORT_NAMES[index], socket)?;
            stream.set_nonblocking(true).map_err(|error| EmulatorError::Connection("port", error))?;
            Ok(stream)
        };
        let ports = [connect_port(0, console)?, connect_port(1, autopilot)?, connect_port(2, instrument)?];
        let lockstep = qemu.connect_socket("lockstep", lockstep)?;
        lockstep.set_read_timeout(Some(POLL_PERIOD)).map_err(|error| EmulatorError::Connection("lockstep", error))?;
        let mut qmp = Qmp::new(qemu.connect_socket("machine protocol", qmp)?)?;
        // With an image for another machine QEMU may end before it answers.
        qmp.execute_commands(&[json!({ "execute": "cont" })])
            .map_err(|error| qemu.exit_error(EXIT_TIMEOUT).unwrap_or(error))?;
        Ok(Self { qemu, qmp, ports, lockstep, stop_flag, _directory: directory })
    }

    /// Waits for the machine's next message; returns it with the ticks since the last reset.
    pub fn wait_for_message(&mut self) -> Result<(MachineMessage, u64), EmulatorError> {
        let mut bytes = [0; 9];
        let read_result = fill_until_stopped(&mut self.lockstep, &mut bytes, &self.stop_flag);
        // An interrupt from the terminal also ends QEMU.
        if self.stop_flag.load(Ordering::SeqCst) {
            return Err(EmulatorError::Interrupted);
        }
        if let Err(error) = read_result {
            return Err(self.qemu.exit_error(EXIT_TIMEOUT).unwrap_or(EmulatorError::Connection("lockstep", error)));
        }
        let [kind, ticks @ ..] = bytes;
        let message = match kind {
            b'B' => MachineMessage::Started,
            b'T' => MachineMessage::Step,
            b'S' => MachineMessage::Sensor,
            b'W' => MachineMessage::Written,
            other => return Err(EmulatorError::Protocol(format!("lockstep {other:#04x}"))),
        };
        Ok((message, u64::from_le_bytes(ticks)))
    }

    /// Sets the field at the sensor, microtesla in chip axes.
    pub fn set_field(&mut self, field_ut: Vector3<f32>) -> Result<(), EmulatorError> {
        let commands = ["mag-x", "mag-y", "mag-z"]
            .iter()
            .zip(field_ut.iter().zip(FIELD_OFFSET_UT).zip(MAX_FIELD_NT))
            .map(|(property, ((&ut, added_field_ut), largest_nt))| {
                let value = ((f64::from(ut) + added_field_ut) * NT_PER_UT).round().clamp(0.0, largest_nt) as i64;
                json!({
                    "execute": "qom-set",
                    "arguments": { "path": "mag", "property": property, "value": value },
                })
            });
        self.qmp.execute_commands(&commands.collect::<Vec<_>>())
    }

    /// Continues the machine. Each port receives at most 255 bytes; excess bytes are dropped.
    pub fn resume(&mut self, step_input: &StepInput) -> Result<(), EmulatorError> {
        let mut message = Vec::new();
        for ((stream, name), bytes) in self.ports.iter_mut().zip(PORT_NAMES).zip(&step_input.port_bytes) {
            let bytes = &bytes[..bytes.len().min(MAX_STEP_BYTES)];
            stream.write_all(bytes).map_err(|error| EmulatorError::Connection(name, error))?;
            message.push(bytes.len() as u8);
        }
        message.push(step_input.step_flags());
        self.lockstep.write_all(&message).map_err(|error| EmulatorError::Connection("lockstep", error))
    }

    /// Bytes that a port has written since the last call.
    pub fn take_output(&mut self, port: usize) -> Result<Vec<u8>, EmulatorError> {
        read_available(&mut self.ports[port]).map_err(|error| EmulatorError::Connection(PORT_NAMES[port], error))
    }

    /// Resets the machine.
    pub fn reset_machine(&mut self) -> Result<(), EmulatorError> {
        self.qmp.execute_commands(&[json!({ "execute": "system_reset" })])
    }
}

struct Qemu {
    child: Child,
    log: PathBuf,
    stop_flag: Arc<AtomicBool>,
}

impl Qemu {
    /// Connects as soon as the socket exists.
    fn connect_socket(&mut self, socket_name: &'static str, socket: &Path) -> Result<LocalStream, EmulatorError> {
        let failed = |error| EmulatorError::Connection(socket_name, error);
        let mut remaining_time = REPLY_TIMEOUT;
        loop {
            match qmp::connect_socket(socket) {
                Ok(stream) => {
                    stream.set_read_timeout(Some(REPLY_TIMEOUT)).map_err(failed)?;
                    return Ok(stream);
                }
                Err(_) if self.stop_flag.load(Ordering::SeqCst) => return Err(EmulatorError::Interrupted),
                Err(error) if remaining_time.is_zero() => return Err(failed(error)),
                Err(_) => {
                    if let Some(ended) = self.exit_error(POLL_PERIOD) {
                        return Err(ended);
                    }
                    remaining_time = remaining_time.saturating_sub(POLL_PERIOD);
                }
            }
        }
    }

    /// QEMU's output, if it has ended or ends within this time.
    fn exit_error(&mut self, within: Duration) -> Option<EmulatorError> {
        let mut remaining_time = within;
        while !matches!(self.child.try_wait(), Ok(Some(_))) {
            if remaining_time.is_zero() {
                return None;
            }
            std::thread::sleep(POLL_PERIOD);
            remaining_time = remaining_time.saturating_sub(POLL_PERIOD);
        }
        Some(EmulatorError::Ended(fs::read_to_string(&self.log).unwrap_or_default()))
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn qemu_command(image: &Path, flash: &Path, [console, autopilot, lockstep, instrument, qmp]: &[PathBuf; 5]) -> Command {
    let mut command = Command::new(QEMU_PROGRAM);
    command
        // QEMU starts stopped, so that no bytes are lost before all ports are connected.
        .args(["-S", "-nodefaults", "-display", "none"])
        .args(["-machine", "mps2-an386,memory-backend=flash"])
        .arg("-object")
        .arg(format!("memory-backend-file,id=flash,size={FLASH_BYTES},share=on,mem-path={}", flash.display()))
        .arg("-icount")
        .arg(format!("shift={ICOUNT_SHIFT},sleep=off"))
        .args(["-device", "lsm303dlhc_mag,id=mag,address=0x1e"])
        .arg("-kernel")
        .arg(image)
        .arg("-qmp")
        .arg(format!("unix:{},server=on,wait=off", qmp.display()))
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    for socket in [console, autopilot, lockstep, instrument] {
        command.arg("-serial").arg(format!("unix:{},server=on,wait=off", socket.display()));
    }
    command
}

/// Fills `bytes` from a stream within [`REPLY_TIMEOUT`] and until `stop_flag` is set; the stream has a short read
/// timeout.
fn fill_until_stopped(stream: &mut LocalStream, bytes: &mut [u8], stop_flag: &AtomicBool) -> std::io::Result<()> {
    let (mut filled_count, mut remaining_time) = (0, REPLY_TIMEOUT);
    while filled_count < bytes.len() && !stop_flag.load(Ordering::SeqCst) {
        match stream.read(&mut bytes[filled_count..]) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(read) => filled_count += read,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock && !remaining_time.is_zero() => {
                remaining_time = remaining_time.saturating_sub(POLL_PERIOD);
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Reads all available bytes. An ended process is no error here: the lockstep connection detects it.
fn read_available(stream: &mut LocalStream) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut buffer = [0; 4096];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return Ok(bytes),
            Ok(read) => bytes.extend_from_slice(&buffer[..read]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(bytes),
            Err(error) => return Err(error),
        }
    }
}
