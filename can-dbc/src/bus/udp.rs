//! The bus for hosts without kernel CAN: python-can's `udp_multicast` on the loopback interface.
//!
//! Each bus is one multicast group, so any number of nodes and python-can listeners may join it:
//! `can.Bus("239.74.163.2", interface="udp_multicast", port=43113)`. Datagrams leave with TTL 0
//! through 127.0.0.1, so they never reach a network. UDP keeps no order with other senders and may
//! drop when a reader is slow; the kernel's drop count and the E2E counters show it.

mod wire;

use super::kernel_socket::{self, Arrival, DropCounter};
use super::{Backend, Bus, BusCounts, OpenError, ReceiveError, Received, SendError};
use crate::frame::Frame;
use core::time::Duration;
use rustix::fd::{AsFd, OwnedFd};
use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

/// Larger than any datagram that is a frame.
const DATAGRAM_CAPACITY: usize = 1024;
/// Datagrams looked at in one call before it returns with nothing.
const SKIPPED_MAX: usize = 1024;
/// Senders whose machine is remembered.
const NEIGHBOURS: usize = 8;

/// Where and as whom to join.
#[derive(Clone, Copy, Debug)]
pub struct UdpOptions<'a> {
    /// Multicast group, one per bus; see [`Udp::group_of_bus`].
    pub group: Ipv4Addr,
    /// UDP port, one per run; see [`PortLease`](super::PortLease).
    pub port: u16,
    /// Sent as python-can's `channel`, which its tools show; empty for none, at most 15 bytes.
    pub tag: &'a str,
}

/// A node on a UDP multicast bus.
#[derive(Debug)]
pub struct Udp {
    name: String,
    receiver: OwnedFd,
    /// A port of its own, so that its datagrams can be told from those of other nodes.
    sender: UdpSocket,
    own_address: SocketAddrV4,
    echoes: bool,
    tag: wire::Tag,
    neighbours: Neighbours,
    drops: DropCounter,
    counts: BusCounts,
}

impl Udp {
    /// python-can's default port, the first a run should try.
    pub const FIRST_PORT: u16 = 43113;

    /// The group of bus `index`: 239.74.163.2 (python-can's default) plus the index.
    pub const fn group_of_bus(index: u8) -> Ipv4Addr {
        Ipv4Addr::new(239, 74, 163, 2_u8.saturating_add(index))
    }

    /// Joins a bus.
    ///
    /// # Errors
    /// [`OpenError`] naming the group, port or tag and the remedy.
    pub fn join(options: UdpOptions<'_>) -> Result<Self, OpenError> {
        let UdpOptions { group, port, tag } = options;
        if !group.is_multicast() {
            return Err(OpenError::NotMulticast { group });
        }
        let tag = wire::Tag::new(tag)
            .ok_or_else(|| OpenError::LongTag { tag: tag.to_owned(), max: wire::Tag::CAPACITY })?;
        let name = format!("udp:{group}:{port}");
        let failed = |step| {
            let what = name.clone();
            move |source: io::Error| match source.kind() {
                io::ErrorKind::AddrInUse => OpenError::PortBusy { port },
                io::ErrorKind::PermissionDenied => OpenError::Permission { what },
                _ => OpenError::Os { what, step, source },
            }
        };
        let receiver = open_receiver(group, port).map_err(failed("join the group on 127.0.0.1"))?;
        kernel_socket::prepare(receiver.as_fd()).map_err(failed("ask for receive times"))?;
        let sender = open_sender(group, port).map_err(failed("open a socket on 127.0.0.1"))?;
        let own_address = match sender.local_addr().map_err(failed("read its own address"))? {
            std::net::SocketAddr::V4(address) => address,
            std::net::SocketAddr::V6(_) => unreachable!("the socket was bound to an IPv4 address"),
        };
        Ok(Self {
            name,
            receiver,
            sender,
            own_address,
            echoes: false,
            tag,
            neighbours: Neighbours::default(),
            drops: DropCounter::default(),
            counts: BusCounts::default(),
        })
    }

    /// Hears its own frames too, in their place among those of the others.
    #[must_use]
    pub fn with_echo(mut self) -> Self {
        self.echoes = true;
        self
    }

    /// The frame in a datagram from a node of this machine; anything else is counted.
    fn accept(&mut self, arrival: &Arrival, datagram: &[u8]) -> Option<Received> {
        self.counts.receive_overflow += self.drops.advance(arrival);
        let sender = arrival.sender?;
        let own = sender == self.own_address;
        if own {
            self.counts.own_echo += 1;
            if !self.echoes {
                return None;
            }
        } else if !self.neighbours.is_on_this_machine(*sender.ip()) {
            self.counts.foreign += 1;
            return None;
        }
        let frame = if arrival.is_truncated { None } else { wire::unpack(datagram) };
        match frame {
            Some(frame) => {
                self.counts.received += u64::from(!own);
                Some(Received { frame, stamp_ns: arrival.stamp_ns, own })
            }
            None => {
                self.counts.malformed += 1;
                None
            }
        }
    }
}

impl Bus for Udp {
    fn backend(&self) -> Backend {
        Backend::Udp
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn echoes(&self) -> bool {
        self.echoes
    }

    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let packed = wire::Packed::of(frame, &self.tag);
        match self.sender.send(packed.bytes()) {
            Ok(_) => {
                self.counts.sent += 1;
                Ok(())
            }
            Err(error) => Err(super::count_send_error(&mut self.counts, &error)),
        }
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        let mut buffer = [0; DATAGRAM_CAPACITY];
        for _ in 0..SKIPPED_MAX {
            match kernel_socket::receive(self.receiver.as_fd(), &mut buffer) {
                Ok(None) => return Ok(None),
                Ok(Some(arrival)) => {
                    let received = self.accept(&arrival, &buffer[..arrival.length]);
                    if received.is_some() {
                        return Ok(received);
                    }
                }
                Err(error) => return Err(super::count_receive_error(&mut self.counts, &error)),
            }
        }
        Ok(None)
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        kernel_socket::wait(self.receiver.as_fd(), timeout)
    }

    fn counts(&self) -> BusCounts {
        self.counts
    }
}

/// A socket bound to the group itself, or the buses of a run, which share a port, would hear each
/// other. The group is joined on 127.0.0.1 only: no network sees a membership report.
fn open_receiver(group: Ipv4Addr, port: u16) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, flags, None)?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    bind(&socket, &SocketAddrV4::new(group, port))?;
    sockopt::set_ip_add_membership(&socket, &group, &Ipv4Addr::LOCALHOST)?;
    Ok(socket)
}

fn open_sender(group: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0))?;
    socket.set_nonblocking(true)?;
    sockopt::set_ip_multicast_if(&socket, &Ipv4Addr::LOCALHOST)?;
    socket.set_multicast_loop_v4(true)?;
    socket.set_multicast_ttl_v4(0)?;
    socket.connect(SocketAddrV4::new(group, port))?;
    Ok(socket)
}

/// Remembers which addresses belong to this machine.
///
/// python-can sends from the machine's network address, so 127.0.0.1 alone would be too narrow;
/// and a python-can on another machine of the network must not drive a truck here.
#[derive(Debug, Default)]
struct Neighbours {
    known: [Option<(Ipv4Addr, bool)>; NEIGHBOURS],
    next: usize,
}

impl Neighbours {
    fn is_on_this_machine(&mut self, address: Ipv4Addr) -> bool {
        if address.is_loopback() {
            return true;
        }
        if let Some((_, verdict)) = self.known.iter().flatten().find(|(known, _)| *known == address)
        {
            return *verdict;
        }
        // A socket binds to the machine's own addresses only.
        let verdict = UdpSocket::bind(SocketAddrV4::new(address, 0)).is_ok();
        self.known[self.next] = Some((address, verdict));
        self.next = (self.next + 1) % NEIGHBOURS;
        verdict
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_machine_is_told_from_this_one() {
        let mut neighbours = Neighbours::default();
        assert!(neighbours.is_on_this_machine(Ipv4Addr::new(127, 0, 0, 1)));
        for _ in 0..2 {
            // 203.0.113.0/24 is reserved for documentation (RFC 5737): nobody's own.
            assert!(!neighbours.is_on_this_machine(Ipv4Addr::new(203, 0, 113, 9)));
        }
    }

    #[test]
    fn a_group_that_is_no_multicast_address_is_refused() {
        let group = Ipv4Addr::new(192, 168, 0, 1);
        let refused = Udp::join(UdpOptions { group, port: 47_000, tag: "" });
        assert!(matches!(refused, Err(OpenError::NotMulticast { .. })));
    }

    #[test]
    fn a_port_held_by_another_program_is_named() {
        let group = Udp::group_of_bus(250);
        // Held without SO_REUSEADDR, and for every address, the group's among them.
        let holder = UdpSocket::bind("0.0.0.0:0").expect("a free port");
        let port = holder.local_addr().expect("bound").port();
        let refused = Udp::join(UdpOptions { group, port, tag: "" });
        assert!(matches!(refused, Err(OpenError::PortBusy { port: named }) if named == port));
    }
}
