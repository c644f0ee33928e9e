//! Non-blocking connections: TCP on the loopback interface. `pty.rs` has the pseudo-terminals of Unix.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::Duration;

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
