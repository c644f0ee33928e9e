//! The simulated module for those outside: bytes on its ports, orders to its pilot, somebody else's simulator.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the module, its ports, time |
//! | `order.rs` | what a person tells the pilot to fly |
//! | `pilot.rs` | what the pilot does about it, and which pattern is flown meanwhile |
//! | `visitor.rs` | attitudes of somebody else's simulator |
//! | `peer.rs` | whether an autopilot talks at the autopilot's port |
//! | `image.rs` | the flash in a file |
//!
//! Time here is virtual: [`Served::advance`] goes on by as much as it is told, and what happens is a function of the
//! seed and of what came in at which instant. Who runs it against a clock on the wall, over which wires, is the command
//! line's business.

mod image;
mod order;
mod peer;
mod pilot;
mod visitor;

pub use self::image::{Image, ImageError};
pub use self::order::{Order, OrderError, WORDS};
pub use self::pilot::Pattern;
pub use self::visitor::{DatagramError, told_attitude};

use crate::devices::uart::HostEnd;
use crate::module::Module as _;
use crate::rig::Rig;
use crate::world::WorldConfig;
use crate::world::rotation::Euler;

use self::peer::Peer;
use self::pilot::Pilot;

/// One of the module's ports.
#[derive(Debug)]
pub struct Port {
    /// What it is called.
    pub name: &'static str,
    /// What goes in and comes out, in a few words.
    pub carries: &'static str,
    cable: fn(&Rig) -> &HostEnd,
}

/// The ports that the module has, in their order.
pub const PORTS: &[Port] = &[
    Port { name: "console", carries: "a terminal", cable: |rig| &rig.console },
    Port { name: "port 1", carries: "an autopilot: MAVLink or MSP, found by itself", cable: |rig| &rig.autopilot },
    Port { name: "port 2", carries: "an instrument: NMEA heading", cable: |rig| &rig.instrument },
];

/// Where in [`PORTS`] the console is, the autopilot's port, and the instrument's.
pub const CONSOLE: usize = 0;
/// See [`CONSOLE`].
pub const AUTOPILOT: usize = 1;
/// See [`CONSOLE`].
pub const INSTRUMENT: usize = 2;

/// Who sends the module its attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Attitude {
    /// The simulator, but while somebody at the autopilot's port sends attitude he alone.
    #[default]
    Auto,
    /// The simulator always.
    Own,
    /// Only who is attached to the autopilot's port.
    Peer,
}

/// How the module is served.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// What is flown while nobody orders anything.
    pub pattern: Pattern,
    /// Who sends attitude.
    pub attitude: Attitude,
    /// Whether somebody else's simulator says how the aircraft lies.
    pub is_visited: bool,
}

/// The pilot looks up, and attitude changes hands, at whole multiples of this.
const TICK_US: u64 = 100_000;

/// Bytes on their way into a port before no more are taken: a tenth of a second of them.
const ON_THE_WAY: usize = 1152;

/// The simulated module in its aircraft, ready to be fed and listened to.
pub struct Served {
    rig: Rig,
    pilot: Pilot,
    peer: Peer,
    attitude: Attitude,
    visits: Option<Visits>,
}

/// Attitudes that somebody else's simulator has told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Visits {
    /// Those that were followed.
    pub followed: u64,
    /// Those that were none.
    pub malformed: u64,
}

impl Served {
    /// A module that is switched on now, its flash empty or as in an image; the aircraft is under way and armed, unless
    /// somebody else flies it.
    #[must_use]
    pub fn new(world: WorldConfig, options: Options, image: Option<&Image>) -> Self {
        let mut rig = Rig::new(world);
        if let Some(image) = image {
            // An image is of that size: it was read as one, or was a flash's contents.
            rig.load_flash(image.bytes());
        }
        rig.world.set_sends_attitude(options.attitude != Attitude::Peer);
        let pilot = Pilot::new(&world, options.pattern, options.is_visited);
        pilot.begin(&rig.world);
        let visits = options.is_visited.then(Visits::default);
        Self { rig, pilot, peer: Peer::default(), attitude: options.attitude, visits }
    }

    /// Microseconds since it was switched on.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.rig.now_us()
    }

    /// Goes on by so many microseconds. In how many pieces makes no difference.
    pub fn advance(&mut self, by_us: u64) {
        let until_us = self.now_us() + by_us;
        while self.now_us() < until_us {
            let tick_us = (self.now_us() / TICK_US + 1) * TICK_US;
            // Nothing cuts the power of this rig.
            let _ = self.rig.run_until(tick_us.min(until_us));
            if self.now_us() == tick_us {
                self.pilot.look_up(&self.rig.world);
                self.hand_over_attitude();
            }
        }
    }

    /// Sends bytes into a port, by its place in [`PORTS`]; another is no port, and nothing happens.
    pub fn feed(&mut self, port: usize, bytes: &[u8]) {
        let Some(Port { cable, .. }) = PORTS.get(port) else { return };
        cable(&self.rig).send(bytes);
        if port == AUTOPILOT {
            self.peer.hear(self.rig.now_us(), bytes);
            self.hand_over_attitude();
        }
    }

    /// Takes what has come out of a port, by its place in [`PORTS`]; of another nothing has.
    #[must_use]
    pub fn take(&self, port: usize) -> Vec<u8> {
        PORTS.get(port).map_or_else(Vec::new, |port| (port.cable)(&self.rig).receive())
    }

    /// Carries out what a person orders the pilot in a line, and gives the answer.
    ///
    /// # Errors
    ///
    /// [`OrderError`] when that is no order, or none for now.
    pub fn order(&mut self, line: &str) -> Result<String, OrderError> {
        match line.parse()? {
            Order::Help => Ok(order::help()),
            Order::Status => Ok(self.status()),
            order => self.pilot.obey(&self.rig.world, order),
        }
    }

    /// Brings the aircraft to the attitude of a datagram `roll_deg pitch_deg yaw_deg`.
    ///
    /// # Errors
    ///
    /// [`DatagramError`] when it is none; it is counted, and nothing else happens.
    pub fn told(&mut self, datagram: &[u8]) -> Result<(), DatagramError> {
        let told = told_attitude(datagram);
        let visits = self.visits.get_or_insert_default();
        match told {
            Ok(Euler { .. }) => visits.followed += 1,
            Err(_) => visits.malformed += 1,
        }
        told.map(|attitude| self.rig.world.follow(attitude))
    }

    /// What somebody else's simulator has told so far; none if nobody was asked to.
    #[must_use]
    pub fn visits(&self) -> Option<Visits> {
        self.visits
    }

    /// Bytes that may be fed into a port now, so that there are never many on their way; none into what is no port.
    #[must_use]
    pub fn room(&self, port: usize) -> usize {
        PORTS.get(port).map_or(0, |port| ON_THE_WAY.saturating_sub((port.cable)(&self.rig).unsent()))
    }

    /// What the flash holds now.
    #[must_use]
    pub fn flash(&self) -> Image {
        Image(self.rig.flash.contents())
    }

    /// How often the flash has been changed, word by word and page by page.
    #[must_use]
    pub fn flash_changes(&self) -> u64 {
        let wear = self.rig.flash.wear();
        wear.erases + wear.writes
    }

    /// The truth, and who tells it.
    fn status(&self) -> String {
        let truth = self.rig.world.true_state(self.now_us());
        let [roll_deg, pitch_deg] = [truth.roll_rad, truth.pitch_rad].map(f64::to_degrees);
        let seconds = self.now_us() as f64 / 1e6;
        let flies = if self.visits.is_some() { "as told" } else { self.pilot.doing() };
        let source = if self.rig.world.sends_attitude() { "the simulator" } else { "who is attached" };
        let told = self.visits.map_or_else(String::new, |Visits { followed, malformed }| {
            format!("; {followed} attitudes told, {malformed} malformed")
        });
        format!(
            "ok {seconds:.1} s, {flies}: roll {roll_deg:.1}, pitch {pitch_deg:.1}, magnetic heading {:.1} deg; attitude \
             from {source}{told}",
            truth.heading_deg()
        )
    }

    fn hand_over_attitude(&self) {
        if self.attitude == Attitude::Auto {
            self.rig.world.set_sends_attitude(!self.peer.talks(self.rig.now_us()));
        }
    }
}
