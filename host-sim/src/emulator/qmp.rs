//! QEMU's machine protocol (QMP): a line of JSON each way.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;

use serde_json::{Value, json};

use super::error::EmulatorError;

/// A connection in command mode.
pub struct Qmp {
    reader: BufReader<UnixStream>,
    writer: UnixStream,
}

impl Qmp {
    /// Takes the greeting and leaves negotiation.
    pub fn new(stream: UnixStream) -> Result<Self, EmulatorError> {
        let writer = stream.try_clone().map_err(failed)?;
        let mut qmp = Self { reader: BufReader::new(stream), writer };
        qmp.line()?;
        qmp.execute(&[json!({ "execute": "qmp_capabilities" })])?;
        Ok(qmp)
    }

    /// Executes commands and waits until all are done.
    pub fn execute(&mut self, commands: &[Value]) -> Result<(), EmulatorError> {
        // In one write: each would be a turn of QEMU's loop.
        let lines: Vec<String> = commands.iter().map(Value::to_string).collect();
        self.writer.write_all((lines.join("\n") + "\n").as_bytes()).map_err(failed)?;
        for _ in commands {
            self.done()?;
        }
        Ok(())
    }

    /// Waits for the next answer; what QEMU tells unasked is passed over.
    fn done(&mut self) -> Result<(), EmulatorError> {
        loop {
            let line = self.line()?;
            if line.get("return").is_some() {
                return Ok(());
            }
            if line.get("event").is_none() {
                return Err(EmulatorError::Protocol(line.to_string()));
            }
        }
    }

    fn line(&mut self) -> Result<Value, EmulatorError> {
        let mut text = String::new();
        self.reader.read_line(&mut text).map_err(failed)?;
        serde_json::from_str(&text).map_err(|_| EmulatorError::Protocol(text))
    }
}

fn failed(error: std::io::Error) -> EmulatorError {
    EmulatorError::Connection("machine protocol", error)
}
