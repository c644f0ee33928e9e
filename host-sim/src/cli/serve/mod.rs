//! `host-sim serve` and `host-sim console`.

mod pace;
mod run;
mod wire;

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use host_sim::serve::{self, Image, ImageError, PORTS, Pattern, Served};
use host_sim::world::WorldConfig;
use host_sim::world::aircraft::Kind;
use serde_json::{Value, json};

use self::run::{Orders, Wiring};
use self::wire::{Pty, TcpPort, Terminal, Wire};
use super::interruption::{Interruption, Second};

use super::print;
use super::range::{any, known_port, port, speed};
use super::{Failure, iron, iron_of};

/// Serve the simulated module: attach a terminal, an autopilot, an instrument or a simulator of your own to it.
///
/// The module runs in real time, or --speed times as fast, with its ports on pseudo-terminals and, with --tcp, on TCP
/// ports of this computer. How to attach to each is printed. It flies a pattern; type on standard input what to fly
/// instead. Try:
///
///   host-sim serve --tcp 5760
///   host-sim console --tcp 5760        in another terminal; then: cal start
///
/// Exit codes: 130 ended by Ctrl-C, 2 the command was wrong or a port is not to be had.
#[derive(Args)]
#[command(verbatim_doc_comment, after_long_help = after_help())]
pub struct Serve {
    #[command(flatten)]
    aboard: Aboard,
    /// Serve each port on TCP, too, on successive ports of this computer from this one on, 0 to 65535: console, then
    /// autopilot, then instrument; 0: any that are free. Up to eight may attach to each
    #[arg(long, value_name = "PORT", value_parser = port)]
    tcp: Option<u16>,
    /// Lie as somebody else's simulator says: UDP datagrams to this port of this computer, 0 to 65535 (0: any that is
    /// free), each a text `roll_deg pitch_deg yaw_deg`, right wing down and nose up positive, yaw from magnetic north, 20 a second or more.
    /// The simulator's own attitude then says that it is disarmed
    #[arg(long, value_name = "PORT", value_parser = port)]
    world: Option<u16>,
    /// Who sends the module its attitude: the simulator but while somebody at the autopilot's port does (auto), always the
    /// simulator (own), or only who is at that port (peer). The module itself changes to another sender after 10 s
    #[arg(long, value_enum, default_value = "auto", value_name = "auto|own|peer")]
    attitude: AttitudeArgument,
    /// Print where the ports are as one JSON object
    #[arg(long)]
    json: bool,
}

/// Type to a module, as `picocom` would: one that is served, or one of its own.
///
/// With --tcp or the path of a pseudo-terminal, of a module that `host-sim serve` serves; with a board's serial port, of
/// the board (set its speed to 115200 baud with stty). With neither a module of its own flies meanwhile. Ctrl-] ends. What
/// is piped in is typed, and its answers are waited for.
#[derive(Args)]
pub struct Console {
    /// Pseudo-terminal or serial port
    #[arg(value_name = "PATH", conflicts_with = "tcp")]
    path: Option<PathBuf>,
    /// TCP port of this computer, 1 to 65535
    #[arg(long, value_name = "PORT", value_parser = known_port)]
    tcp: Option<u16>,
    #[command(flatten)]
    aboard: Aboard,
}

/// What is served.
#[derive(Args)]
struct Aboard {
    /// Times as fast as real time, 0.01 to 200
    #[arg(long, default_value_t = 1.0, value_name = "N", value_parser = speed)]
    speed: f64,
    /// Iron: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an airframe file such as
    /// host-sim/airframes/example.toml
    #[arg(long, default_value = "table1", value_name = "table1|random|FILE")]
    airframe: String,
    /// Seed of weather, ground, waves, noise and, for `random`, of the airframe and the place: 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = any)]
    seed: u64,
    /// What flies [default: plane, or what the airframe file says]
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(Kind::ALL.map(Kind::name)))]
    aircraft: Option<String>,
    /// What is flown while nobody orders anything
    #[arg(long, default_value = Pattern::default().name(), value_name = "NAME",
        value_parser = PossibleValuesParser::new(Pattern::ALL.map(Pattern::name)))]
    pattern: String,
    /// Keep the module's flash in this file, so that it remembers its calibration the next time
    #[arg(long, value_name = "FILE")]
    flash: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum AttitudeArgument {
    Auto,
    Own,
    Peer,
}

impl From<AttitudeArgument> for serve::Attitude {
    fn from(argument: AttitudeArgument) -> Self {
        match argument {
            AttitudeArgument::Auto => Self::Auto,
            AttitudeArgument::Own => Self::Own,
            AttitudeArgument::Peer => Self::Peer,
        }
    }
}

/// An order and what it does, within a terminal's width.
fn listed(order: &str, does: &str) -> String {
    let mut text = String::new();
    print::say(&mut text, &" ".repeat(15), does);
    format!("  {order:13}{}", text.trim_start())
}

fn after_help() -> String {
    let orders = serve::WORDS.map(|(order, does)| listed(order, does)).concat();
    format!(
        "Orders, a line each on standard input, answered by `ok` or `error <code>`; without --world:\n{orders}\n\
         Attach, with --tcp 5760 (or the pseudo-terminal that is printed in place of the TCP port):\n  \
           host-sim console --tcp 5760           type to the module\n  \
           nc 127.0.0.1 5762                     read its headings\n  \
           gpsd -N -n tcp://127.0.0.1:5762       the same for a navigation program\n  \
           --serial5=tcpclient:127.0.0.1:5761    ArduPilot's simulator as the attitude\n    \
             source, with SERIAL5_PROTOCOL 2\n\n\
         The virtual time of the module stands still while this program does not run; what the module does is a function of \
         the seed and of what comes in when."
    )
}

/// Why something outside cannot be had.
fn failed(code: &str, why: impl std::fmt::Display) -> Failure {
    Failure(format!("{code}: {why}"))
}

impl Aboard {
    fn world(&self) -> Result<WorldConfig, Failure> {
        let world = iron(&self.airframe, self.seed)?;
        Ok(self.aircraft.as_deref().and_then(Kind::from_name).map_or(world, |kind| world.carried_by(kind)))
    }

    fn module(&self, attitude: serve::Attitude, is_visited: bool) -> Result<Served, Failure> {
        let pattern = Pattern::from_name(&self.pattern).unwrap_or_default();
        let no_flash = |error: ImageError| failed(error.code(), error);
        let image = self.flash.as_deref().map(Image::read).transpose().map_err(no_flash)?.flatten();
        let served = Served::new(self.world()?, serve::Options { pattern, attitude, is_visited }, image.as_ref());
        if let Some(path) = &self.flash {
            // Now, while somebody looks, and not first when there is a calibration to be lost.
            served.flash().write(path).map_err(no_flash)?;
        }
        Ok(served)
    }
}

pub fn serve(options: &Serve) -> Result<ExitCode, Failure> {
    let interruption = Interruption::awaited(Second::Ends)?;
    let mut served = options.aboard.module(options.attitude.into(), options.world.is_some())?;
    let mut wires: Vec<Vec<Box<dyn Wire>>> = Vec::new();
    let mut places = Vec::new();
    let mut next = options.tcp;
    for port in PORTS {
        let pty = Pty::open().map_err(|error| failed("no-pty", error))?;
        let tcp = next.map(tcp_port).transpose()?;
        next = next.map(|number| if number == 0 { 0 } else { number.wrapping_add(1) });
        places.push(Place { port, pty: pty.path.clone(), tcp: tcp.as_ref().map(|tcp| tcp.port) });
        let tcp = tcp.map(|tcp| Box::new(tcp) as Box<dyn Wire>);
        wires.push(std::iter::once(Box::new(pty) as Box<dyn Wire>).chain(tcp).collect());
    }
    let world = options.world.map(world_port).transpose()?;
    let world_number = world.as_ref().and_then(|world| world.local_addr().ok()).map(|address| address.port());
    if options.json {
        print::json(described(&options.aboard, &places, world_number)?)?;
    } else {
        introduce(&options.aboard, &places, world_number)?;
    }
    let wiring = Wiring { wires, world, orders: Some(Orders::typed()), flash: options.aboard.flash.clone() };
    wiring.run(&mut served, options.aboard.speed, interruption.stop())?;
    Ok(interruption.code().unwrap_or(ExitCode::SUCCESS))
}

fn tcp_port(number: u16) -> Result<TcpPort, Failure> {
    TcpPort::open(number).map_err(|error| failed("tcp-unavailable", format!("port {number}: {error}")))
}

fn world_port(number: u16) -> Result<UdpSocket, Failure> {
    let socket =
        UdpSocket::bind((Ipv4Addr::LOCALHOST, number)).and_then(|socket| socket.set_nonblocking(true).map(|()| socket));
    socket.map_err(|error| failed("world-unavailable", format!("port {number}: {error}")))
}

/// Where a port of the module is.
struct Place {
    port: &'static serve::Port,
    pty: PathBuf,
    tcp: Option<u16>,
}

/// What a script reads.
fn described(aboard: &Aboard, places: &[Place], world: Option<u16>) -> Result<Value, Failure> {
    let ports: Vec<Value> =
        places.iter().map(|place| json!({ "name": place.port.name, "pty": place.pty, "tcp": place.tcp })).collect();
    Ok(json!({ "ports": ports, "world": world, "airframe": iron_of(&aboard.world()?) }))
}

/// What a person reads.
fn introduce(aboard: &Aboard, places: &[Place], world: Option<u16>) -> Result<(), Failure> {
    for (index, Place { port, pty, tcp }) in places.iter().enumerate() {
        let pty = pty.display();
        say(&format!("{}: {}", port.name, port.carries));
        let is_console = index == serve::CONSOLE;
        let with = if is_console { format!("picocom {pty}") } else { format!("cat {pty}") };
        say(&format!("  {pty:<22}{with}"));
        if let Some(number) = tcp {
            let with =
                if is_console { format!("host-sim console --tcp {number}") } else { format!("nc 127.0.0.1 {number}") };
            say(&format!("  {:<22}{with}", format!("tcp 127.0.0.1:{number}")));
        }
    }
    match world {
        Some(number) => {
            let example = format!("printf '0 0 90' > /dev/udp/127.0.0.1/{number}");
            say(&format!("attitude of the aircraft\n  {:<22}{example}", format!("udp 127.0.0.1:{number}")));
        }
        None => say(&format!("the aircraft flies: {}. Order it to do something else: help lists how", aboard.pattern)),
    }
    if aboard.airframe == "random" {
        let file = aboard.world()?.iron_file();
        print::line(format_args!("the airframe of seed {}, as a file for --airframe:\n\n{file}", aboard.seed));
    }
    say("Ctrl-C ends");
    Ok(())
}

/// A line for who started it.
fn say(line: &str) {
    print::line(line);
}

pub fn console(options: &Console) -> Result<ExitCode, Failure> {
    let no_module = |what: String| move |error: io::Error| failed("no-module", format!("{what}: {error}"));
    match (&options.path, options.tcp) {
        (Some(path), _) => attach(wire::serial(path).map_err(no_module(path.display().to_string()))?),
        (None, Some(port)) => attach(wire::tcp(port).map_err(no_module(format!("TCP port {port}")))?),
        (None, None) => alone(&options.aboard),
    }
}

/// How often wires are looked at. The module's own delays are longer.
const LOOK: Duration = Duration::from_millis(2);

/// Bytes at a time; what is typed or printed in between.
const PIECE: usize = 4096;

fn attach(mut module: impl Wire) -> Result<ExitCode, Failure> {
    let interruption = Interruption::awaited(Second::Ends)?;
    let mut terminal = open_terminal()?;
    while !interruption.stop().load(Ordering::SeqCst) && !terminal.has_ended() {
        module.write(&terminal.read(PIECE));
        terminal.write(&module.read(PIECE));
        if module.has_ended() {
            drop(terminal);
            return Err(failed("no-module", "the module has gone"));
        }
        thread::sleep(LOOK);
    }
    drop(terminal);
    Ok(interruption.code().unwrap_or(ExitCode::SUCCESS))
}

fn open_terminal() -> Result<Terminal, Failure> {
    if io::IsTerminal::is_terminal(&io::stdin()) {
        print::complain("Ctrl-] ends");
    }
    Terminal::open().map_err(|error| failed("no-terminal", error))
}

/// With a module of its own: the terminal is its console, and nothing else is attached.
fn alone(aboard: &Aboard) -> Result<ExitCode, Failure> {
    let mut served = aboard.module(serve::Attitude::Own, false)?;
    let mut wires: Vec<Vec<Box<dyn Wire>>> = PORTS.iter().map(|_| Vec::new()).collect();
    let interruption = Interruption::awaited(Second::Ends)?;
    wires[serve::CONSOLE].push(Box::new(open_terminal()?));
    let wiring = Wiring { wires, world: None, orders: None, flash: aboard.flash.clone() };
    wiring.run(&mut served, aboard.speed, interruption.stop())?;
    Ok(interruption.code().unwrap_or(ExitCode::SUCCESS))
}

/// The flash on its way to its file, whenever it has changed and come to rest.
struct Keeper<'a> {
    path: Option<&'a Path>,
    kept: u64,
    seen: u64,
}

impl<'a> Keeper<'a> {
    fn new(path: Option<&'a Path>) -> Self {
        Self { path, kept: 0, seen: 0 }
    }

    /// Looks once more; at the end it does not wait for rest.
    fn look(&mut self, served: &Served, is_end: bool) -> Result<(), Failure> {
        let Some(path) = self.path else { return Ok(()) };
        let changes = served.flash_changes();
        let rests = changes == self.seen || is_end;
        self.seen = changes;
        if rests && changes != self.kept {
            served.flash().write(path).map_err(|error| failed(error.code(), error))?;
            self.kept = changes;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use crate::cli::Cli;

    /// A line over a subcommand in the list of them would hide all but the first line of what is said there.
    #[test]
    fn the_help_of_every_command_is_the_whole_of_it() {
        let cli = Cli::command();
        cli.clone().debug_assert();
        let commands = cli.get_subcommands().flat_map(|command| [command].into_iter().chain(command.get_subcommands()));
        let mut seen = 0;
        for command in commands.filter(|command| !["bench", "help", "speed"].contains(&command.get_name())) {
            let long = command.get_long_about().map(ToString::to_string).unwrap_or_default();
            assert!(long.lines().count() > 2, "{}: {long}", command.get_name());
            seen += 1;
        }
        assert_eq!(seen, 9, "fly, emulate, serve, console, table1, replay; of bench accuracy, integrity, budget");
    }
}
