//! The module with its wires, for as long as somebody wants it.

use std::io;
use std::net::UdpSocket;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread;

use host_sim::serve::Served;

use super::pace::Pace;
use super::wire::{Wire, reading};
use super::{Failure, Keeper, LOOK, PIECE, print, say};

/// Everything that is attached.
pub struct Wiring {
    /// The wires of each of the module's ports.
    pub wires: Vec<Vec<Box<dyn Wire>>>,
    /// Where somebody else's simulator sends attitudes.
    pub world: Option<UdpSocket>,
    /// Where orders are typed.
    pub orders: Option<Orders>,
    /// Where the flash is kept.
    pub flash: Option<PathBuf>,
}

/// Datagrams that are read at a time: what floods is lost in the system's own buffer.
const DATAGRAMS: usize = 64;

impl Wiring {
    /// Until it is stopped, a wire has ended, or nobody reads what is printed.
    pub fn run(mut self, served: &mut Served, speed: f64, stop: &AtomicBool) -> Result<(), Failure> {
        let mut pace = Pace::new(speed);
        let mut keeper = Keeper::new(self.flash.as_deref());
        let mut is_malformed_told = false;
        let has_ended = |wires: &[Vec<Box<dyn Wire>>]| wires.iter().flatten().any(|wire| wire.has_ended());
        while !stop.load(Ordering::SeqCst) && !has_ended(&self.wires) && !print::is_left() {
            for (port, wires) in self.wires.iter_mut().enumerate() {
                for wire in wires {
                    // As on a real line, who sends faster than it carries waits.
                    let bytes = wire.read(served.room(port).min(PIECE));
                    served.feed(port, &bytes);
                }
            }
            if let Some(world) = &self.world {
                is_malformed_told |= follow(world, served, is_malformed_told);
            }
            if let Some(orders) = &mut self.orders {
                orders.carry_out(served);
            }
            served.advance(pace.passed_us());
            for (port, wires) in self.wires.iter_mut().enumerate() {
                let bytes = served.take(port);
                for wire in wires {
                    wire.write(&bytes);
                }
            }
            if let Some(complaint) = pace.complaint() {
                print::complain(format_args!("{complaint}\r"));
            }
            keeper.look(served, false)?;
            thread::sleep(LOOK);
        }
        keeper.look(served, true)
    }
}

/// Follows what has been told; whether the first that was no attitude has been complained about.
fn follow(world: &UdpSocket, served: &mut Served, is_told: bool) -> bool {
    let mut datagram = [0; 256];
    let mut is_told = is_told;
    for _ in 0..DATAGRAMS {
        let Ok(length) = world.recv(&mut datagram) else { break };
        if let Err(error) = served.told(&datagram[..length])
            && !is_told
        {
            print::complain(format_args!("error {}: {error}; more of them are only counted, see status", error.code()));
            is_told = true;
        }
    }
    is_told
}

/// Lines of standard input.
pub struct Orders {
    typed: Receiver<Vec<u8>>,
    line: Vec<u8>,
}

/// What is longer is no order.
const LONGEST_LINE: usize = 256;

impl Orders {
    /// What is typed from now on.
    pub fn typed() -> Self {
        Self { typed: reading(io::stdin()), line: Vec::new() }
    }

    fn carry_out(&mut self, served: &mut Served) {
        while let Ok(bytes) = self.typed.try_recv() {
            for byte in bytes {
                if byte == b'\n' {
                    answer(served, &std::mem::take(&mut self.line));
                } else if self.line.len() <= LONGEST_LINE {
                    self.line.push(byte);
                }
            }
        }
    }
}

fn answer(served: &mut Served, line: &[u8]) {
    let line = String::from_utf8_lossy(line);
    if line.len() > LONGEST_LINE {
        say("error line-too-long: an order has at most 256 characters");
    } else if !line.trim().is_empty() {
        match served.order(&line) {
            Ok(answer) => say(&answer),
            Err(error) => say(&format!("error {}: {error}", error.code())),
        }
    }
}
