//! QEMU with the firmware in it, and the wires to it.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use nalgebra::Vector3;
use serde_json::json;
use tempfile::TempDir;

use super::error::EmulatorError;
use super::image;
use super::qmp::Qmp;

/// The firmware's own counter, ticks a microsecond.
pub const TICKS_PER_US: u64 = 25;

/// Nanoseconds of such a tick.
pub const TICK_NS: u64 = 1000 / TICKS_PER_US;

/// Nanoseconds an instruction takes, as a power of two (QEMU's `-icount shift`): 64 ns, so that the machine is five
/// times slower than the reference board's 80 MHz.
const ICOUNT_SHIFT: u32 = 6;
pub const INSTRUCTION_NS: u64 = 1 << ICOUNT_SHIFT;

/// Bytes of the memory that stands for flash: the machine's PSRAM.
const FLASH_BYTES: usize = 16 << 20;

/// A machine that says nothing for so long has stopped. It is the computer's time, and only ends runs that hang.
const PATIENCE: Duration = Duration::from_mins(1);

/// Between two looks at whether it has started or ended, or is to end.
const PAUSE: Duration = Duration::from_millis(10);

/// A QEMU that has closed a connection ends within this time.
const ENDING: Duration = Duration::from_secs(2);

/// Microtesla on x, y and z that make QEMU's values, which may not be negative, out of those that are. The firmware's
/// board file takes them off.
const ADDED_UT: [f64; 3] = [93.0, 93.0, 104.0];
/// QEMU counts in nanotesla.
const NT_PER_UT: f64 = 1000.0;
/// What QEMU takes at this gain: 2047 counts at 1100 and 980 counts a gauss.
const LARGEST_NT: [f64; 3] = [186_000.0, 186_000.0, 208_800.0];

/// Why the machine has stopped for the world to move on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// It has started, and goes on by itself.
    Started,
    /// Time has passed.
    Step,
    /// It is about to look at the sensor.
    Sensor,
    /// It has written to the instrument, and goes on by itself.
    Written,
}

/// What the machine goes on with.
#[derive(Clone, Debug, Default)]
pub struct Go {
    /// Bytes to the console.
    pub console: Vec<u8>,
    /// Bytes to the autopilot port.
    pub autopilot: Vec<u8>,
    /// Bytes to the instrument port.
    pub instrument: Vec<u8>,
    /// Whether the sensor's data wire is broken.
    pub sensor_broken: bool,
    /// A test that the bench image is to run.
    pub test: Option<BenchTest>,
}

impl Go {
    /// The last byte of the message: bit 0 breaks the sensor's wire, those above are the number of a test.
    fn flags(&self) -> u8 {
        u8::from(self.sensor_broken) | self.test.map_or(0, |test| test as u8) << 1
    }
}

/// What the bench image can do beyond the product; the numbers are those of its board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BenchTest {
    /// Counts instructions and prints the counts on the console's port.
    Budgets = 1,
    /// Executes what is no instruction.
    Fault = 2,
    /// Fills the stack.
    Overflow = 3,
    /// Panics.
    Panic = 4,
}

/// The most bytes a [`Go`] may bring on each wire.
pub const MOST_BYTES: usize = 255;

/// A running QEMU. It ends with this value.
pub struct Machine {
    qemu: Qemu,
    qmp: Qmp,
    console: UnixStream,
    autopilot: UnixStream,
    instrument: UnixStream,
    lockstep: UnixStream,
    /// Whoever runs it wants it to end.
    stop: Arc<AtomicBool>,
    /// Sockets and flash; gone with this value.
    _directory: TempDir,
}

impl Machine {
    /// Starts QEMU with a firmware image; its flash is erased. When `stop` is set, it is no longer waited for.
    pub fn start(image: &Path, stop: Arc<AtomicBool>) -> Result<Self, EmulatorError> {
        image::check(image)?;
        let directory = tempfile::tempdir().map_err(|error| EmulatorError::Connection("directory", error))?;
        let flash = directory.path().join("flash.bin");
        fs::write(&flash, vec![0xFF; FLASH_BYTES]).map_err(|error| EmulatorError::Connection("flash", error))?;
        let sockets = ["console", "autopilot", "lockstep", "instrument", "qmp"].map(|name| directory.path().join(name));
        let log = directory.path().join("log");
        let stderr = fs::File::create(&log).map_err(|error| EmulatorError::Connection("log", error))?;
        let child = command(image, &flash, &sockets).stderr(stderr).spawn().map_err(EmulatorError::NoQemu)?;
        let mut qemu = Qemu { child, log, stop: Arc::clone(&stop) };
        let [console, autopilot, lockstep, instrument, qmp] = &sockets;
        let console = not_waited_for(qemu.connect("console", console)?)?;
        let autopilot = not_waited_for(qemu.connect("autopilot port", autopilot)?)?;
        let instrument = not_waited_for(qemu.connect("instrument port", instrument)?)?;
        let lockstep = qemu.connect("lockstep", lockstep)?;
        lockstep.set_read_timeout(Some(PAUSE)).map_err(|error| EmulatorError::Connection("lockstep", error))?;
        let mut qmp = Qmp::new(qemu.connect("machine protocol", qmp)?)?;
        // With an image for another machine it may end before it has answered.
        qmp.execute(&[json!({ "execute": "cont" })]).map_err(|error| qemu.why_ended(ENDING).unwrap_or(error))?;
        Ok(Self { qemu, qmp, console, autopilot, instrument, lockstep, stop, _directory: directory })
    }

    /// Waits for the machine's next message; with it come its clock's ticks since its last reset.
    pub fn listen(&mut self) -> Result<(Message, u64), EmulatorError> {
        let mut bytes = [0; 9];
        let read = read_until(&mut self.lockstep, &mut bytes, &self.stop);
        // A terminal tells QEMU to end, too.
        if self.stop.load(Ordering::SeqCst) {
            return Err(EmulatorError::Interrupted);
        }
        if let Err(error) = read {
            return Err(self.qemu.why_ended(ENDING).unwrap_or(EmulatorError::Connection("lockstep", error)));
        }
        let [kind, ticks @ ..] = bytes;
        let message = match kind {
            b'B' => Message::Started,
            b'T' => Message::Step,
            b'S' => Message::Sensor,
            b'W' => Message::Written,
            other => return Err(EmulatorError::Protocol(format!("lockstep {other:#04x}"))),
        };
        Ok((message, u64::from_le_bytes(ticks)))
    }

    /// Sets the field at the sensor, microtesla in the chip's axes.
    pub fn set_field(&mut self, field_ut: Vector3<f32>) -> Result<(), EmulatorError> {
        let commands = ["mag-x", "mag-y", "mag-z"].iter().zip(field_ut.iter().zip(ADDED_UT).zip(LARGEST_NT)).map(
            |(property, ((&ut, added_ut), largest_nt))| {
                let value = ((f64::from(ut) + added_ut) * NT_PER_UT).round().clamp(0.0, largest_nt) as i64;
                json!({
                    "execute": "qom-set",
                    "arguments": { "path": "mag", "property": property, "value": value },
                })
            },
        );
        self.qmp.execute(&commands.collect::<Vec<_>>())
    }

    /// Lets the machine go on. Each wire brings [`MOST_BYTES`] at most; the rest is not sent.
    pub fn go(&mut self, go: &Go) -> Result<(), EmulatorError> {
        let send = |stream: &mut UnixStream, bytes: &[u8], what| {
            stream.write_all(bytes).map_err(|error| EmulatorError::Connection(what, error))
        };
        let [console, autopilot, instrument] =
            [&go.console, &go.autopilot, &go.instrument].map(|bytes| &bytes[..bytes.len().min(MOST_BYTES)]);
        send(&mut self.console, console, "console")?;
        send(&mut self.autopilot, autopilot, "autopilot port")?;
        send(&mut self.instrument, instrument, "instrument port")?;
        let message = [console.len() as u8, autopilot.len() as u8, instrument.len() as u8, go.flags()];
        send(&mut self.lockstep, &message, "lockstep")
    }

    /// What the machine has written to console, autopilot and instrument so far.
    pub fn written(&mut self) -> Result<[Vec<u8>; 3], EmulatorError> {
        Ok([
            available(&mut self.console).map_err(|error| EmulatorError::Connection("console", error))?,
            available(&mut self.autopilot).map_err(|error| EmulatorError::Connection("autopilot port", error))?,
            available(&mut self.instrument).map_err(|error| EmulatorError::Connection("instrument port", error))?,
        ])
    }

    /// Presses the machine's reset button.
    pub fn reset(&mut self) -> Result<(), EmulatorError> {
        self.qmp.execute(&[json!({ "execute": "system_reset" })])
    }
}

/// The process; killed with this value.
struct Qemu {
    child: Child,
    /// What it says.
    log: PathBuf,
    stop: Arc<AtomicBool>,
}

impl Qemu {
    /// Connects as soon as it has made the socket.
    fn connect(&mut self, what: &'static str, socket: &Path) -> Result<UnixStream, EmulatorError> {
        let failed = |error| EmulatorError::Connection(what, error);
        let mut left = PATIENCE;
        loop {
            match UnixStream::connect(socket) {
                Ok(stream) => {
                    stream.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
                    return Ok(stream);
                }
                Err(_) if self.stop.load(Ordering::SeqCst) => return Err(EmulatorError::Interrupted),
                Err(error) if left.is_zero() => return Err(failed(error)),
                Err(_) => {
                    if let Some(ended) = self.why_ended(PAUSE) {
                        return Err(ended);
                    }
                    left = left.saturating_sub(PAUSE);
                }
            }
        }
    }

    /// What it said last, if it has ended by itself or does so within this time.
    fn why_ended(&mut self, within: Duration) -> Option<EmulatorError> {
        let mut left = within;
        while !matches!(self.child.try_wait(), Ok(Some(_))) {
            if left.is_zero() {
                return None;
            }
            std::thread::sleep(PAUSE);
            left = left.saturating_sub(PAUSE);
        }
        Some(EmulatorError::Ended(fs::read_to_string(&self.log).unwrap_or_default()))
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn command(image: &Path, flash: &Path, [console, autopilot, lockstep, instrument, qmp]: &[PathBuf; 5]) -> Command {
    let mut command = Command::new(super::QEMU);
    command
        // Stopped until all are connected, lest the first bytes be lost.
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

fn not_waited_for(stream: UnixStream) -> Result<UnixStream, EmulatorError> {
    stream.set_nonblocking(true).map_err(|error| EmulatorError::Connection("port", error))?;
    Ok(stream)
}

/// Fills `bytes` from a stream that looks up every [`PAUSE`], within [`PATIENCE`] and as long as nobody wants to stop.
fn read_until(stream: &mut UnixStream, bytes: &mut [u8], stop: &AtomicBool) -> std::io::Result<()> {
    let (mut filled, mut left) = (0, PATIENCE);
    while filled < bytes.len() && !stop.load(Ordering::SeqCst) {
        match stream.read(&mut bytes[filled..]) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(read) => filled += read,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock && !left.is_zero() => left = left.saturating_sub(PAUSE),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// All bytes that are there; an end of the stream is seen by whoever listens to the lockstep.
fn available(stream: &mut UnixStream) -> std::io::Result<Vec<u8>> {
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
