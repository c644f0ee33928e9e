//! Wires out of this program: pseudo-terminals, TCP on the loopback, the terminal it runs in. None of them waits.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal as _, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

use super::super::print;

/// A wire with somebody at its far end, or nobody.
pub trait Wire {
    /// What has come in, so many bytes at most.
    fn read(&mut self, most: usize) -> Vec<u8>;

    /// Sends; what nobody takes is lost, as on any wire.
    fn write(&mut self, bytes: &[u8]);

    /// Whether nothing will ever come or go any more.
    fn has_ended(&self) -> bool {
        false
    }
}

/// Bytes that a slow listener is behind before he loses some: six seconds of a full line.
const BACKLOG: usize = 65_536;

/// A stream that does not wait, with what it has not taken yet.
struct Stream<S> {
    far: S,
    backlog: VecDeque<u8>,
    /// Nobody is at the far end.
    is_away: bool,
}

impl<S: Read + Write> Stream<S> {
    fn new(far: S) -> Self {
        Self { far, backlog: VecDeque::new(), is_away: false }
    }

    fn read(&mut self, most: usize) -> Vec<u8> {
        let mut bytes = vec![0; most];
        let read = match self.far.read(&mut bytes) {
            Ok(0) if most > 0 => Err(ErrorKind::UnexpectedEof.into()),
            read => read,
        };
        // A pseudo-terminal that nobody has opened says that it cannot be read.
        self.is_away = read.as_ref().is_err_and(|error: &io::Error| !is_passing(error));
        bytes.truncate(read.unwrap_or(0));
        bytes
    }

    fn write(&mut self, bytes: &[u8]) {
        if self.is_away {
            self.backlog.clear();
            return;
        }
        if self.backlog.len() + bytes.len() <= BACKLOG {
            self.backlog.extend(bytes);
        }
        while !self.backlog.is_empty() {
            match self.far.write(self.backlog.as_slices().0) {
                Ok(written) if written > 0 => drop(self.backlog.drain(..written)),
                Err(error) if is_passing(&error) => return,
                _ => {
                    self.is_away = true;
                    return;
                }
            }
        }
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// A pseudo-terminal for a terminal program, or whoever expects a serial port. It goes with this value.
pub struct Pty {
    ours: Stream<File>,
    /// What the others open.
    pub path: PathBuf,
}

impl Pty {
    pub fn open() -> io::Result<Self> {
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let path = PathBuf::from(ptsname(&ours, Vec::new())?.to_string_lossy().into_owned());
        rustix::io::ioctl_fionbio(&ours, true)?;
        // Opened and closed once: before that it cannot tell that nobody is there.
        make_raw(&open_serial(&path)?)?;
        Ok(Self { ours: Stream::new(File::from(ours)), path })
    }
}

impl Wire for Pty {
    fn read(&mut self, most: usize) -> Vec<u8> {
        self.ours.read(most)
    }

    fn write(&mut self, bytes: &[u8]) {
        self.ours.write(bytes);
    }
}

/// A pseudo-terminal or serial port of somebody else's.
fn open_serial(path: &Path) -> io::Result<File> {
    let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits().cast_signed();
    OpenOptions::new().read(true).write(true).custom_flags(flags).open(path)
}

/// As a wire: nothing echoed, nothing translated, nothing obeyed. Gives how it was before.
fn make_raw(terminal: impl AsFd) -> io::Result<Termios> {
    let before = tcgetattr(&terminal)?;
    let mut raw = before.clone();
    raw.make_raw();
    tcsetattr(&terminal, OptionalActions::Now, &raw)?;
    Ok(before)
}

/// A TCP port on the loopback. All who connect hear the same, and what any of them sends goes in.
pub struct TcpPort {
    listener: TcpListener,
    clients: Vec<Stream<TcpStream>>,
    /// Its number.
    pub port: u16,
}

/// More than so many at a time are turned away.
const CLIENTS: usize = 8;

impl TcpPort {
    /// This one, or of 0 any that is free.
    pub fn open(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let port = listener.local_addr()?.port();
        Ok(Self { listener, clients: Vec::new(), port })
    }

    fn accept(&mut self) {
        while let Ok((client, _)) = self.listener.accept() {
            if self.clients.len() < CLIENTS && client.set_nonblocking(true).is_ok() {
                // A byte late is late; without this it is only slower.
                let _ = client.set_nodelay(true);
                self.clients.push(Stream::new(client));
            }
        }
    }
}

impl Wire for TcpPort {
    fn read(&mut self, most: usize) -> Vec<u8> {
        self.accept();
        let mut bytes = Vec::new();
        for client in &mut self.clients {
            bytes.extend(client.read(most - bytes.len()));
        }
        self.clients.retain(|client| !client.is_away);
        bytes
    }

    fn write(&mut self, bytes: &[u8]) {
        self.clients.iter_mut().for_each(|client| client.write(bytes));
        self.clients.retain(|client| !client.is_away);
    }
}

/// A module that is served by somebody else.
pub struct Connection<S>(Stream<S>);

/// One at a pseudo-terminal, or a board at a serial port.
pub fn serial(path: &Path) -> io::Result<Connection<File>> {
    let port = open_serial(path)?;
    make_raw(&port)?;
    Ok(Connection(Stream::new(port)))
}

/// One at a TCP port of this computer.
pub fn tcp(port: u16) -> io::Result<Connection<TcpStream>> {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
    stream.set_nonblocking(true)?;
    Ok(Connection(Stream::new(stream)))
}

impl<S: Read + Write> Wire for Connection<S> {
    fn read(&mut self, most: usize) -> Vec<u8> {
        self.0.read(most)
    }

    fn write(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    fn has_ended(&self) -> bool {
        self.0.is_away
    }
}

/// Ctrl-], as in telnet.
const LEAVE: u8 = 0x1D;

/// After the last of what a script types, its answers are waited for until there is a pause of this length.
const PAUSE: Duration = Duration::from_secs(1);

/// The terminal that this program runs in, or whatever it reads and writes instead.
pub struct Terminal {
    typed: Receiver<Vec<u8>>,
    waiting: VecDeque<u8>,
    is_left: bool,
    /// When something came last, once nothing more will be typed.
    ending: Option<Instant>,
    before: Option<Termios>,
}

impl Terminal {
    /// Makes it a wire to the module, until this value is gone.
    pub fn open() -> io::Result<Self> {
        let stdin = io::stdin();
        let before = if stdin.is_terminal() { Some(make_raw(&stdin)?) } else { None };
        Ok(Self { typed: reading(stdin), waiting: VecDeque::new(), is_left: false, ending: None, before })
    }

    fn listen(&mut self) {
        loop {
            match self.typed.try_recv() {
                Ok(bytes) => self.waiting.extend(bytes),
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => {
                    self.ending.get_or_insert_with(Instant::now);
                    return;
                }
            }
        }
    }
}

impl Wire for Terminal {
    fn read(&mut self, most: usize) -> Vec<u8> {
        self.listen();
        let bytes: Vec<u8> = self.waiting.drain(..most.min(self.waiting.len())).collect();
        let is_typed_by_a_person = self.before.is_some();
        self.is_left |= is_typed_by_a_person && bytes.contains(&LEAVE);
        bytes
    }

    fn write(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.ending = self.ending.map(|_| Instant::now());
        }
        print::bytes(bytes);
        // Nobody looks any more.
        self.is_left |= print::is_lost();
    }

    fn has_ended(&self) -> bool {
        let is_answered = |last: Instant| self.waiting.is_empty() && last.elapsed() > PAUSE;
        self.is_left || self.ending.is_some_and(is_answered)
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // There is nobody left to tell.
            let _ = tcsetattr(io::stdin(), OptionalActions::Now, before);
        }
    }
}

/// What comes of something that waits, from a thread that does the waiting; it disconnects at its end.
pub fn reading(mut from: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    // Who types faster than he is heard waits: a file or a pipe without end does not fill the memory.
    let (sender, receiver) = mpsc::sync_channel(16);
    thread::spawn(move || {
        let mut bytes = [0; 1024];
        while let Ok(read) = from.read(&mut bytes)
            && read > 0
            && sender.send(bytes[..read].to_vec()).is_ok()
        {}
    });
    receiver
}
