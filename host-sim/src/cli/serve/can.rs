//! CAN bus on a multicast group of the local network.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};

use autoswing::wire::dronecan::CanFrame;
use host_sim::serve::multicast::{MAX_DATAGRAM_SIZE, from_datagram, to_datagram};
use socket2::{Domain, Socket, Type};

const MULTICAST_PORT: u16 = 57_732;

/// Largest number of datagrams read in one poll.
const MAX_DATAGRAMS_PER_POLL: usize = 256;

/// The bus of a number, shared with other programs of this computer.
pub struct MulticastBus {
    group: Ipv4Addr,
    input: UdpSocket,
    output: UdpSocket,
}

impl MulticastBus {
    pub fn open_bus(number: u8) -> io::Result<Self> {
        let group = Ipv4Addr::new(239, 65, 82, number);
        let input = Socket::new(Domain::IPV4, Type::DGRAM, None)?;
        input.set_nonblocking(true)?;
        // Other programs bind the same port, which needs this option before `bind`; `std` cannot set it.
        input.set_reuse_address(true)?;
        // On Windows a socket cannot be bound to a multicast group.
        let address = if cfg!(unix) { group } else { Ipv4Addr::UNSPECIFIED };
        input.bind(&SocketAddrV4::new(address, MULTICAST_PORT).into())?;
        let input = UdpSocket::from(input);
        // A computer without a network has only the loopback interface.
        let join = |interface| input.join_multicast_v4(&group, &interface);
        join(Ipv4Addr::UNSPECIFIED).or_else(|_| join(Ipv4Addr::LOCALHOST))?;
        let output = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        output.set_nonblocking(true)?;
        Ok(Self { group, input, output })
    }

    /// Frames that other programs sent to the bus since the last call.
    pub fn receive_frames(&self) -> Vec<CanFrame> {
        let own = self.output.local_addr().map(|address| address.port());
        let is_own = |from: SocketAddr| own.as_ref().is_ok_and(|own| *own == from.port());
        let mut datagram = [0; MAX_DATAGRAM_SIZE];
        let datagrams = (0..MAX_DATAGRAMS_PER_POLL).map_while(|_| {
            self.input
                .recv_from(&mut datagram)
                .ok()
                .map(|(length, from)| from_datagram(&datagram[..length]).filter(|_| !is_own(from)))
        });
        datagrams.flatten().collect()
    }

    /// Sends a frame; it is lost where the network does not take it, as on a bus without other nodes.
    pub fn send_frame(&self, frame: &CanFrame) {
        let _ = self.output.send_to(&to_datagram(frame), (self.group, MULTICAST_PORT));
    }
}
