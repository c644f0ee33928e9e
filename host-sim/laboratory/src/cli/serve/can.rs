//! CAN bus on a multicast group of the local network.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};

use crate::serve::multicast::{MAX_DATAGRAM_SIZE, from_datagram, to_datagram};
use autoswing_firmware::wire::dronecan::CanFrame;
use socket2::{Domain, Socket, Type};

const MULTICAST_PORT: u16 = 57_732;

/// Largest number of datagrams read in one poll.
const MAX_DATAGRAMS_PER_POLL: usize = 256;

/// The bus of a number, shared with other programs of this computer.
pub struct MulticastBus {
    group: Ipv4Addr,
    receive_socket: UdpSocket,
    send_socket: UdpSocket,
}

impl MulticastBus {
    pub fn open_bus(number: u8) -> io::Result<Self> {
        let group = Ipv4Addr::new(239, 65, 82, number);
        let receive_socket = Socket::new(Domain::IPV4, Type::DGRAM, None)?;
        receive_socket.set_nonblocking(true)?;
        // Other programs bind the same port, which needs this option before `bind`; `std` cannot set it.
        receive_socket.set_reuse_address(true)?;
        // On Windows a socket cannot be bound to a multicast group.
        let address = if cfg!(unix) { group } else { Ipv4Addr::UNSPECIFIED };
        receive_socket.bind(&SocketAddrV4::new(address, MULTICAST_PORT).into())?;
        let receive_socket = UdpSocket::from(receive_socket);
        // A computer without a network has only the loopback interface.
        let join = |interface| receive_socket.join_multicast_v4(&group, &interface);
        join(Ipv4Addr::UNSPECIFIED).or_else(|_| join(Ipv4Addr::LOCALHOST))?;
        let send_socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        send_socket.set_nonblocking(true)?;
        Ok(Self { group, receive_socket, send_socket })
    }

    /// Frames that other programs sent to the bus since the last call.
    pub fn receive_frames(&self) -> Vec<CanFrame> {
        let own = self.send_socket.local_addr().map(|address| address.port());
        let is_own = |from: SocketAddr| own.as_ref().is_ok_and(|own| *own == from.port());
        let mut datagram = [0; MAX_DATAGRAM_SIZE];
        let datagrams = (0..MAX_DATAGRAMS_PER_POLL).map_while(|_| {
            self.receive_socket
                .recv_from(&mut datagram)
                .ok()
                .map(|(length, from)| from_datagram(&datagram[..length]).filter(|_| !is_own(from)))
        });
        datagrams.flatten().collect()
    }

    /// Sends a frame; it is lost where the network does not take it, as on a bus without other nodes.
    pub fn send_frame(&self, frame: &CanFrame) {
        let _ = self.send_socket.send_to(&to_datagram(frame), (self.group, MULTICAST_PORT));
    }
}
