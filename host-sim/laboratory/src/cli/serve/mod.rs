//! `lab serve`.

mod byte_connections;
mod can;
#[cfg_attr(not(unix), path = "no_pty.rs")]
mod pty;
mod serve_loop;

use std::net::{Ipv4Addr, UdpSocket};
use std::path::PathBuf;
use std::process::ExitCode;

use crate::serve::{self, AttitudeProvider, PORTS, PilotPattern, ServedModule};
use clap::Args;
use log_analysis::numbers::json_name;
use serde_json::{Value, json};
use simulator::devices::sensor::SensorModel;
use simulator::mission_report::airframe_json;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;

use self::byte_connections::{ByteConnection, TcpPort};
use self::can::MulticastBus;
use host_sim::termination::{SecondSignal, TerminationSignals};
use serve_loop::{Connections, FlashWriter, PilotCommandInput};

use host_sim::command_failure::CommandFailure;
use host_sim::file_options::named_world;
use host_sim::option_parsers::{integer_in_range, number_in_range, one_of};
use host_sim::print;

/// Serve the simulated module to a terminal, an autopilot, an instrument or another simulator.
///
/// The module runs in real time, or --speed times as fast, with its ports on pseudo-terminals and, with --tcp, on TCP
/// ports of this computer; Windows has no pseudo-terminals and needs --tcp. The program prints how to attach to each.
/// The aircraft flies a pattern; orders typed on standard input change it. Try:
///
/// `lab serve --tcp 5760`
///
/// `nc 127.0.0.1 5760` in another terminal; then: cal start
///
/// Until an autopilot sends attitude to its port, the simulator sends attitude, current and, with the airframe table1,
/// position and date. An MSP autopilot needs `--attitude peer`.
///
/// Exit codes: 130 ended by Ctrl-C, 2 wrong command or unavailable port.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab serve --tcp 5760", after_long_help = after_help())]
pub struct ServeCommandOptions {
    /// Speed relative to real time, 0.01 to 200
    #[arg(long, default_value_t = 1.0, value_name = "N", value_parser = number_in_range(0.01, 200.0))]
    speed: f64,
    /// Airframe's hard and soft iron: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an
    /// airframe file such as host-sim/airframes/example.toml
    #[arg(long, default_value = "table1", value_name = "table1|random|FILE")]
    airframe: String,
    /// Seed of weather, ground, waves, noise and, for `random`, of airframe and place, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer_in_range(0, u64::MAX))]
    seed: u64,
    /// Kind of aircraft [default: plane, or that of the airframe file]
    #[arg(long, value_name = "KIND", value_parser = one_of::<VehicleKind>("plane|copter|vtol|rover|boat|hand"))]
    aircraft: Option<VehicleKind>,
    /// Magnetometer of the module: the reference board's LIS3MDL, or an RM3100
    #[arg(long, default_value = "lis3mdl", value_name = "lis3mdl|rm3100", value_parser = one_of::<SensorModel>("lis3mdl|rm3100"))]
    sensor: SensorModel,
    /// Pattern that is flown without orders
    #[arg(long, default_value = "routine", value_name = "NAME",
        value_parser = one_of::<PilotPattern>("routine|circles|wandering|level"))]
    pattern: PilotPattern,
    /// Store the module's flash in this file, so that a calibration survives the program
    #[arg(long, value_name = "FILE")]
    flash: Option<PathBuf>,
    /// Serve the ports also on successive TCP ports of this computer, starting at this one, 0 to 65535: console,
    /// autopilot, instrument; 0: any free ones. Each accepts up to eight clients
    #[arg(long, value_name = "PORT", value_parser = integer_in_range(0, u16::MAX))]
    tcp: Option<u16>,
    /// Take the attitude from another simulator: UDP datagrams to this port of this computer, 0 to 65535 (0: any free
    /// one), each a text `roll_deg pitch_deg yaw_deg [step_s]`, right wing down and nose up positive, yaw from magnetic
    /// north, at 20 Hz or more. The simulator's own attitude is then sent as disarmed. With step_s, 0 to 1, that
    /// simulator drives the module's clock: the module advances by it, answers with its time, and waits. The first
    /// datagram sets the attitude at once; a later jump can appear to the module as a change of hard iron
    #[arg(long, value_name = "PORT", value_parser = integer_in_range(0, u16::MAX))]
    world: Option<u16>,
    /// Put the module on a CAN bus as a DroneCAN node: mcast:0 to mcast:9, UDP multicast in the local network, as
    /// ArduPilot's simulator and pydronecan use it
    #[arg(long, value_name = "mcast:N", value_parser = parse_can_bus)]
    can: Option<u8>,
    /// Sender of the module's attitude: the simulator unless the autopilot's port receives one (auto), always the
    /// simulator, only that port (peer), or none (own): then type `set attitude own` at the console, and a satellite
    /// receiver sends the speed to port 2. The module switches senders after 10 s
    #[arg(long, default_value = "auto", value_name = "auto|simulator|peer|own", value_parser = one_of::<AttitudeProvider>("auto|simulator|peer|own"))]
    attitude: AttitudeProvider,
    /// Print the ports as one JSON object
    #[arg(long)]
    json: bool,
}

fn parse_can_bus(name: &str) -> Result<u8, String> {
    match name.strip_prefix("mcast:").map(str::as_bytes) {
        Some([digit @ b'0'..=b'9']) => Ok(digit - b'0'),
        _ => Err("must be mcast:0 to mcast:9".to_owned()),
    }
}

/// An order with its description, wrapped to a terminal's width.
fn format_order(order: &str, description: &str) -> String {
    let mut text = String::new();
    print::append_wrapped(&mut text, &" ".repeat(16), description);
    format!("  {order:14}{}", text.trim_start())
}

fn after_help() -> String {
    let command_list = serve::COMMANDS.map(|(order, description)| format_order(order, description)).concat();
    format!(
        "Example: lab serve --tcp 5760\n\nOrders, a line each on standard input, answered by `ok` or `error <code>`; without --world:\n{command_list}\n\
         Attach, with --tcp 5760 (or the pseudo-terminal that is printed in place of the TCP port):\n  \
           nc 127.0.0.1 5760                     type to the module (or picocom, PuTTY)\n  \
           nc 127.0.0.1 5762                     read its headings\n  \
           gpsd -N -n tcp://127.0.0.1:5762       the same for gpsd, with a declination\n  \
           --serial5=tcpclient:127.0.0.1:5761    ArduPilot's simulator as the attitude\n    \
             source, with SERIAL5_PROTOCOL 2\n\n\
         The virtual time of the module stands still while this program does not run; what the module does is a function of \
         the seed and of what comes in when."
    )
}

impl ServeCommandOptions {
    fn world_config(&self) -> Result<WorldConfig, CommandFailure> {
        let world = WorldConfig { sensor: self.sensor, ..named_world(&self.airframe, self.seed)? };
        Ok(self.aircraft.map_or(world, |vehicle_kind| world.with_vehicle_kind(vehicle_kind)))
    }

    fn build_module(&self) -> Result<(ServedModule, FlashWriter), CommandFailure> {
        let (mut flash_writer, image) = FlashWriter::open_file(self.flash.as_deref())?;
        let served_module = ServedModule::new(
            self.world_config()?,
            serve::ServeOptions {
                flight_pattern: self.pattern,
                attitude: self.attitude,
                has_external_simulator: self.world.is_some(),
                has_can: self.can.is_some(),
            },
            image.as_ref(),
        );
        // The file is written at the start, so that an unwritable one is noticed before a calibration is lost.
        flash_writer.write_flash(&served_module)?;
        Ok((served_module, flash_writer))
    }
}

pub fn run_serve(options: &ServeCommandOptions) -> Result<ExitCode, CommandFailure> {
    let interruption = TerminationSignals::install_handlers(SecondSignal::Exits)?;
    let (mut served_module, flash_writer) = options.build_module()?;
    let mut port_wires: Vec<Vec<Box<dyn ByteConnection>>> = Vec::new();
    let mut port_addresses = Vec::new();
    let mut next = options.tcp;
    for port in PORTS {
        let (pty, pty_path) = pty::open_pty()?.unzip();
        if pty.is_none() && next.is_none() {
            return Err(CommandFailure::with_code(
                "no-pty",
                "this system has no pseudo-terminals; serve TCP ports: --tcp 5760",
            ));
        }
        let tcp = next.map(open_tcp_port).transpose()?;
        next = next.map(|tcp_port_number| if tcp_port_number == 0 { 0 } else { tcp_port_number.wrapping_add(1) });
        port_addresses.push(PortAddress { port, pty: pty_path, tcp: tcp.as_ref().map(|tcp| tcp.port) });
        let tcp = tcp.map(|tcp| Box::new(tcp) as Box<dyn ByteConnection>);
        port_wires.push(pty.into_iter().chain(tcp).collect());
    }
    let world = options.world.map(open_attitude_socket).transpose()?;
    let can = options.can.map(open_can_bus).transpose()?;
    let world_number = world.as_ref().and_then(|world| world.local_addr().ok()).map(|address| address.port());
    if options.json {
        print::print_json(describe_ports(options, &port_addresses, world_number)?)?;
    } else {
        print_ports(options, &port_addresses, world_number)?;
    }
    let wiring = Connections {
        port_wires,
        attitude_socket: world,
        can_bus: can,
        pilot_commands: PilotCommandInput::from_stdin(),
        flash_writer,
    };
    wiring.run_connections(&mut served_module, options.speed, interruption.stop_flag())?;
    Ok(interruption.exit_code().unwrap_or(ExitCode::SUCCESS))
}

fn open_tcp_port(number: u16) -> Result<TcpPort, CommandFailure> {
    TcpPort::open_port(number)
        .map_err(|error| CommandFailure::with_code("tcp-unavailable", format!("port {number}: {error}")))
}

fn open_attitude_socket(number: u16) -> Result<UdpSocket, CommandFailure> {
    let socket =
        UdpSocket::bind((Ipv4Addr::LOCALHOST, number)).and_then(|socket| socket.set_nonblocking(true).map(|()| socket));
    socket.map_err(|error| CommandFailure::with_code("world-unavailable", format!("port {number}: {error}")))
}

fn open_can_bus(number: u8) -> Result<MulticastBus, CommandFailure> {
    MulticastBus::open_bus(number)
        .map_err(|error| CommandFailure::with_code("can-unavailable", format!("{}: {error}", can_bus_name(number))))
}

struct PortAddress {
    port: &'static serve::ServedPort,
    pty: Option<PathBuf>,
    tcp: Option<u16>,
}

fn describe_ports(
    options: &ServeCommandOptions,
    port_addresses: &[PortAddress],
    world: Option<u16>,
) -> Result<Value, CommandFailure> {
    let ports: Vec<Value> = port_addresses
        .iter()
        .map(|address| json!({ "name": address.port.port_name, "pty": address.pty, "tcp": address.tcp }))
        .collect();
    let airframe = airframe_json(&options.world_config()?);
    Ok(json!({ "ports": ports, "world": world, "can": options.can.map(can_bus_name), "airframe": airframe }))
}

fn can_bus_name(number: u8) -> String {
    format!("mcast:{number}")
}

fn print_ports(
    options: &ServeCommandOptions,
    port_addresses: &[PortAddress],
    world: Option<u16>,
) -> Result<(), CommandFailure> {
    for (index, PortAddress { port, pty, tcp }) in port_addresses.iter().enumerate() {
        print::print_line(format_args!("{}: {}", port.port_name, port.traffic_description));
        if let Some(pty) = pty {
            let pty = pty.display();
            let with = match index {
                serve::CONSOLE_PORT => format!("picocom {pty}"),
                serve::AUTOPILOT_PORT => format!("mavproxy.py --master={pty}"),
                _ => format!("cat {pty}"),
            };
            print::print_line(format_args!("  {pty:<22}{with}"));
        }
        if let Some(port_number) = tcp {
            let with = match index {
                serve::AUTOPILOT_PORT => format!("mavproxy.py --master=tcp:127.0.0.1:{port_number}"),
                _ => format!("nc 127.0.0.1 {port_number}"),
            };
            print::print_line(format_args!("  {:<22}{with}", format!("tcp 127.0.0.1:{port_number}")));
        }
    }
    if options.attitude == AttitudeProvider::Own {
        print::print_line("no autopilot is at port 1: type `set attitude own` at the console");
    }
    if let Some(bus) = options.can.map(can_bus_name) {
        print::print_line(format_args!("CAN bus: DroneCAN, in the local network\n  {bus:<22}dronecan_gui_tool"));
    }
    match world {
        Some(port_number) => {
            let example = format!("printf '0 0 90' > /dev/udp/127.0.0.1/{port_number}");
            print::print_line(format_args!(
                "attitude of the aircraft\n  {:<22}{example}",
                format!("udp 127.0.0.1:{port_number}")
            ));
        }
        None => print::print_line(format_args!(
            "the aircraft flies: {}. Order it to do something else: help lists how",
            json_name(options.pattern)
        )),
    }
    if options.airframe == "random" {
        let file = options.world_config()?.airframe_toml();
        print::print_line(format_args!("the airframe of seed {}, as a file for --airframe:\n\n{file}", options.seed));
    }
    print::print_line("Ctrl-C ends");
    Ok(())
}
