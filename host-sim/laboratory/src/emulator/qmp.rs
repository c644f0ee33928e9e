//! Client of QEMU's machine protocol (QMP): one line of JSON per message.

use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

use serde_json::{Value, json};

use super::error::EmulatorError;

/// Connection in command mode.
pub struct Qmp {
    reader: BufReader<LocalStream>,
    writer: LocalStream,
}

impl Qmp {
    /// Reads the greeting and enters command mode.
    pub fn new(stream: LocalStream) -> Result<Self, EmulatorError> {
        let writer = stream.try_clone().map_err(qmp_error)?;
        let mut qmp = Self { reader: BufReader::new(stream), writer };
        qmp.read_json_line()?;
        qmp.execute_commands(&[json!({ "execute": "qmp_capabilities" })])?;
        Ok(qmp)
    }

    /// Executes commands and waits for all answers.
    pub fn execute_commands(&mut self, commands: &[Value]) -> Result<(), EmulatorError> {
        // A single write, because each write costs an iteration of QEMU's main loop.
        let lines: Vec<String> = commands.iter().map(Value::to_string).collect();
        self.writer.write_all((lines.join("\n") + "\n").as_bytes()).map_err(qmp_error)?;
        for _ in commands {
            self.wait_for_response()?;
        }
        Ok(())
    }

    /// Waits for the next answer; ignores events.
    fn wait_for_response(&mut self) -> Result<(), EmulatorError> {
        loop {
            let line = self.read_json_line()?;
            if line.get("return").is_some() {
                return Ok(());
            }
            if line.get("event").is_none() {
                return Err(EmulatorError::Protocol(line.to_string()));
            }
        }
    }

    fn read_json_line(&mut self) -> Result<Value, EmulatorError> {
        let mut text = String::new();
        self.reader.read_line(&mut text).map_err(qmp_error)?;
        serde_json::from_str(&text).map_err(|_| EmulatorError::Protocol(text))
    }
}

fn qmp_error(error: io::Error) -> EmulatorError {
    EmulatorError::Connection("machine protocol", error)
}

/// Whether this system has local sockets. Without them, as on Windows, no emulator starts.
pub const ARE_LOCAL_SOCKETS_SUPPORTED: bool = cfg!(unix);

#[cfg(unix)]
pub use std::os::unix::net::UnixStream as LocalStream;

/// Type in the place of a local socket, which this system does not have; never connected.
#[cfg(not(unix))]
pub use std::net::TcpStream as LocalStream;

/// Connects to a socket.
#[cfg(unix)]
pub fn connect_socket(socket: &Path) -> io::Result<LocalStream> {
    LocalStream::connect(socket)
}

/// Fails: see [`ARE_LOCAL_SOCKETS_SUPPORTED`].
#[cfg(not(unix))]
pub fn connect_socket(_socket: &Path) -> io::Result<LocalStream> {
    Err(io::ErrorKind::Unsupported.into())
}
