//! Non-blocking connections: TCP on the loopback interface, and the program's own terminal. `pty.rs` has those of Unix.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, IsTerminal as _, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

use crossterm::terminal::{disable_raw_mode, enable_raw_mode};

use host_sim::print;

/// Polling interval of the connections, shorter than the module's own delays.
pub const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Largest number of bytes transferred in one poll.
pub const MAX_POLL_BYTES: usize = 4096;

/// A connection whose far end may be absent.
pub trait ByteConnection {
    /// Returns received bytes, at most `max_bytes`.
    fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8>;

    /// Sends bytes; they are lost if nobody receives.
    fn write_bytes(&mut self, bytes: &[u8]);

    /// Programs that attached or left since the last call, as texts.
    fn take_notices(&mut self) -> Vec<String> {
        Vec::new()
    }

    /// Whether the connection is closed for good.
    fn has_ended(&self) -> bool {
        false
    }
}

/// A pseudo-terminal with its path.
pub type OpenedPty = (Box<dyn ByteConnection>, PathBuf);

/// Largest backlog of a slow receiver, bytes: six seconds of a full line.
const MAX_BACKLOG_BYTES: usize = 65_536;

/// A non-blocking stream with a backlog of unsent bytes.
pub struct BufferedStream<S> {
    endpoint: S,
    backlog: VecDeque<u8>,
    pub is_disconnected: bool,
}

impl<S: Read + Write> BufferedStream<S> {
    pub fn new(endpoint: S) -> Self {
        Self { endpoint, backlog: VecDeque::new(), is_disconnected: false }
    }

    pub fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8> {
        let mut bytes = vec![0; max_bytes];
        let read = match self.endpoint.read(&mut bytes) {
            Ok(0) if max_bytes > 0 => Err(ErrorKind::UnexpectedEof.into()),
            read => read,
        };
        // Reading a pseudo-terminal that nobody has opened fails.
        self.is_disconnected = read.as_ref().is_err_and(|error: &io::Error| !is_temporary(error));
        bytes.truncate(read.unwrap_or(0));
        bytes
    }

    pub fn write_bytes(&mut self, bytes: &[u8]) {
        if self.is_disconnected {
            self.backlog.clear();
            return;
        }
        if self.backlog.len() + bytes.len() <= MAX_BACKLOG_BYTES {
            self.backlog.extend(bytes);
        }
        while !self.backlog.is_empty() {
            match self.endpoint.write(self.backlog.as_slices().0) {
                Ok(written) if written > 0 => drop(self.backlog.drain(..written)),
                Err(error) if is_temporary(&error) => return,
                _ => {
                    self.is_disconnected = true;
                    return;
                }
            }
        }
    }
}

fn is_temporary(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// A TCP port on the loopback interface. All clients receive the same bytes and may send.
pub struct TcpPort {
    listener: TcpListener,
    clients: Vec<BufferedStream<TcpStream>>,
    notices: Vec<String>,
    pub port: u16,
}

/// Largest number of clients; further ones are disconnected.
const MAX_CLIENTS: usize = 8;

impl TcpPort {
    pub fn open_port(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let port = listener.local_addr()?.port();
        Ok(Self { listener, clients: Vec::new(), notices: Vec::new(), port })
    }

    fn accept_clients(&mut self) {
        while let Ok((client, from)) = self.listener.accept() {
            if self.clients.len() < MAX_CLIENTS && client.set_nonblocking(true).is_ok() {
                // A failure to set `TCP_NODELAY` is ignored: without it data are only delayed.
                let _ = client.set_nodelay(true);
                self.clients.push(BufferedStream::new(client));
                self.notices.push(format!("{from} attached to TCP port {}", self.port));
            }
        }
    }

    fn drop_disconnected(&mut self) {
        let before = self.clients.len();
        self.clients.retain(|client| !client.is_disconnected);
        for _ in self.clients.len()..before {
            self.notices.push(format!("a program detached from TCP port {}", self.port));
        }
    }
}

impl ByteConnection for TcpPort {
    fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8> {
        self.accept_clients();
        let mut bytes = Vec::new();
        for client in &mut self.clients {
            bytes.extend(client.read_bytes(max_bytes - bytes.len()));
        }
        self.drop_disconnected();
        bytes
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.clients.iter_mut().for_each(|client| client.write_bytes(bytes));
        self.drop_disconnected();
    }

    fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }
}

/// A connection to a module, for a console.
pub struct Connection<S>(pub BufferedStream<S>);

pub fn connect_tcp(port: u16) -> io::Result<Connection<TcpStream>> {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
    stream.set_nonblocking(true)?;
    Ok(Connection(BufferedStream::new(stream)))
}

impl<S: Read + Write> ByteConnection for Connection<S> {
    fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8> {
        self.0.read_bytes(max_bytes)
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.0.write_bytes(bytes);
    }

    fn has_ended(&self) -> bool {
        self.0.is_disconnected
    }
}

/// Key that ends the session: Ctrl-], as in telnet.
const LEAVE_KEY: u8 = 0x1D;

/// Ctrl-D, which ends the session on an empty line.
const END_OF_INPUT_KEY: u8 = 0x04;

/// Ctrl-U, which clears the line.
const CLEAR_LINE_KEY: u8 = 0x15;

/// First character of a line for the simulated pilot.
const PILOT_LINE_PREFIX: u8 = b'!';

/// Longest typed line that is compared with `quit`, bytes.
const MAX_LINE_BYTES: usize = 256;

/// Silence of the module after which it is taken to have answered: ends the session after the end of piped input.
const SILENCE_AFTER_ANSWER: Duration = Duration::from_secs(1);

/// Prompt of the module, which follows an answer.
const PROMPT: [u8; 2] = *b"> ";

/// The program's terminal, or its redirected input and output.
pub struct Terminal {
    byte_receiver: Receiver<Vec<u8>>,
    unprocessed_bytes: VecDeque<u8>,
    /// The line being typed.
    typed_line: Vec<u8>,
    /// Pilot of a private module.
    pilot_line_sender: Option<Sender<Vec<u8>>>,
    is_closed: bool,
    /// Time of the last output after the end of the input.
    last_output_after_input_end: Option<Instant>,
    /// Time of the last piped line or of the output that followed it, until the prompt returns. The next line waits
    /// for the prompt: the module drops characters that arrive during a long answer and do not fit its receive buffer.
    awaited_since: Option<Instant>,
    /// Last bytes of the output.
    output_end: [u8; PROMPT.len()],
    /// Whether a person types, into a terminal in raw mode.
    is_raw: bool,
}

impl Terminal {
    /// Switches the terminal to raw mode until dropped. `pilot_line_sender` receives lines for the simulated pilot.
    pub fn open_terminal(pilot_line_sender: Option<Sender<Vec<u8>>>) -> io::Result<Self> {
        let stdin = io::stdin();
        let is_raw = stdin.is_terminal();
        if is_raw {
            enable_raw_mode()?;
            // On Windows this call turns on the console's control sequences; its answer is not needed.
            #[cfg(windows)]
            let _ = crossterm::ansi_support::supports_ansi();
        }
        Ok(Self {
            byte_receiver: read_in_thread(stdin),
            unprocessed_bytes: VecDeque::new(),
            typed_line: Vec::new(),
            pilot_line_sender,
            is_closed: false,
            last_output_after_input_end: None,
            awaited_since: None,
            output_end: [0; PROMPT.len()],
            is_raw,
        })
    }

    /// Handles a typed byte; returns whether the module receives it.
    fn process_typed_byte(&mut self, byte: u8) -> bool {
        let is_pilot_line =
            self.pilot_line_sender.is_some() && self.typed_line.first().unwrap_or(&byte) == &PILOT_LINE_PREFIX;
        match byte {
            LEAVE_KEY if self.is_raw => self.is_closed = true,
            END_OF_INPUT_KEY if self.is_raw && self.typed_line.is_empty() => self.is_closed = true,
            b'\r' | b'\n' => {
                let typed_line = std::mem::take(&mut self.typed_line);
                if is_pilot_line && !typed_line.is_empty() {
                    self.send_pilot_line(&typed_line);
                    return false;
                }
                if [&b"quit"[..], b"exit"].contains(&typed_line.trim_ascii()) {
                    self.end_session();
                    return false;
                }
            }
            CLEAR_LINE_KEY if !is_pilot_line => self.typed_line.clear(),
            0x08 | 0x7F => {
                self.typed_line.pop();
                if is_pilot_line {
                    print::print_text("\x08 \x08");
                }
            }
            _ if self.typed_line.len() <= MAX_LINE_BYTES => self.typed_line.push(byte),
            _ => {}
        }
        if is_pilot_line && self.is_raw && byte >= b' ' && byte != 0x7F {
            print::print_bytes(&[byte]);
        }
        !is_pilot_line && !self.is_closed
    }

    fn send_pilot_line(&self, typed_line: &[u8]) {
        if self.is_raw {
            print::print_text("\r\n");
        }
        if let Some(pilot_line_sender) = &self.pilot_line_sender {
            // Sending cannot fail: the loop that receives orders lasts as long as the session.
            let _ = pilot_line_sender.send([&typed_line[1..], b"\n"].concat());
        }
    }

    /// Ends the session: immediately at a terminal; with redirected input after [`SILENCE_AFTER_ANSWER`] without
    /// output.
    fn end_session(&mut self) {
        self.is_closed |= self.is_raw;
        self.unprocessed_bytes.clear();
        self.last_output_after_input_end.get_or_insert_with(Instant::now);
    }

    /// Number of bytes to send now: of piped input one line at most, and none until the last line is answered.
    fn sendable_bytes(&self) -> usize {
        if self.is_raw {
            return self.unprocessed_bytes.len();
        }
        if self.awaited_since.is_some_and(|since| since.elapsed() < SILENCE_AFTER_ANSWER) {
            return 0;
        }
        let line_end = self.unprocessed_bytes.iter().position(|&byte| is_line_end(byte));
        line_end.map_or(self.unprocessed_bytes.len(), |end| end + 1)
    }

    fn receive_typed_bytes(&mut self) {
        loop {
            match self.byte_receiver.try_recv() {
                Ok(bytes) => self.unprocessed_bytes.extend(bytes),
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => {
                    self.last_output_after_input_end.get_or_insert_with(Instant::now);
                    return;
                }
            }
        }
    }
}

impl ByteConnection for Terminal {
    fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8> {
        self.receive_typed_bytes();
        let bytes: Vec<u8> = self.unprocessed_bytes.drain(..self.sendable_bytes().min(max_bytes)).collect();
        let was_closed = self.is_closed;
        let mut sent = Vec::new();
        for byte in bytes {
            if self.process_typed_byte(byte) {
                sent.push(byte);
            }
        }
        if self.is_closed && !was_closed {
            // Clears the module's input line: the characters typed so far would otherwise begin the first line of the
            // next session.
            sent.push(CLEAR_LINE_KEY);
        }
        if sent.last().is_some_and(|&byte| is_line_end(byte)) {
            self.awaited_since = Some(Instant::now());
        }
        sent
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.last_output_after_input_end = self.last_output_after_input_end.map(|_| Instant::now());
            self.awaited_since = self.awaited_since.map(|_| Instant::now());
        }
        for &byte in bytes {
            self.output_end = [self.output_end[1], byte];
        }
        if self.output_end == PROMPT {
            self.awaited_since = None;
        }
        print::print_bytes(bytes);
        // The reader closed the output.
        self.is_closed |= print::has_output_failed();
    }

    fn has_ended(&self) -> bool {
        let is_answered = |last: Instant| self.unprocessed_bytes.is_empty() && last.elapsed() > SILENCE_AFTER_ANSWER;
        self.is_closed || self.last_output_after_input_end.is_some_and(is_answered)
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if self.is_raw {
            // An error cannot be reported here.
            let _ = disable_raw_mode();
        }
        if ![0, b'\n'].contains(&self.output_end[1]) {
            print::print_text("\n"); // The shell's prompt begins a line.
        }
    }
}

const fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\r' | b'\n')
}

/// Reads a blocking source in a thread; the channel disconnects at its end.
pub fn read_in_thread(mut source: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    // A bounded channel, so that an endless source does not fill the memory.
    let (sender, receiver) = mpsc::sync_channel(16);
    thread::spawn(move || {
        let mut bytes = [0; 1024];
        while let Ok(read) = source.read(&mut bytes)
            && read > 0
            && sender.send(bytes[..read].to_vec()).is_ok()
        {}
    });
    receiver
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_session_clears_its_line_in_the_module() {
        for (typed, expected_bytes) in
            [(&b"status\rquit\r"[..], &b"status\rquit\x15"[..]), (b"sta\x1d", b"sta\x15"), (b"sta", b"sta")]
        {
            let (sender, byte_receiver) = mpsc::channel();
            sender.send(typed.to_vec()).unwrap();
            let mut terminal = Terminal {
                byte_receiver,
                unprocessed_bytes: VecDeque::new(),
                typed_line: Vec::new(),
                pilot_line_sender: None,
                is_closed: false,
                last_output_after_input_end: None,
                awaited_since: None,
                output_end: [0; PROMPT.len()],
                is_raw: true,
            };
            assert_eq!(terminal.read_bytes(100), expected_bytes);
        }
    }
}
