//! One UDP port per run of the bench on this machine.

use super::OpenError;
use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Ports tried before giving up.
const ATTEMPTS: u16 = 64;

/// The right of one run to a UDP port, held until dropped or until the process ends.
///
/// The lock is the name of a Unix socket in the kernel's abstract namespace. It covers exactly
/// what a UDP port covers, the network namespace, whichever user asks; unlike a lock file it
/// leaves nothing behind and cannot be left locked.
#[derive(Debug)]
pub struct PortLease {
    port: u16,
    /// Never used; its name is the lock.
    _lock: UnixDatagram,
}

impl PortLease {
    /// Leases `first_port` or the next free one above it.
    ///
    /// # Errors
    /// [`OpenError::AllPortsLeased`] after 64 ports, or what the operating system says.
    pub fn acquire(first_port: u16) -> Result<Self, OpenError> {
        let last = first_port.saturating_add(ATTEMPTS - 1);
        for port in first_port..=last {
            if let Some(lock) = lock(port)?
                && is_sharable(port)
            {
                return Ok(Self { port, _lock: lock });
            }
        }
        Err(OpenError::AllPortsLeased { first: first_port, last })
    }

    /// The leased port.
    pub const fn port(&self) -> u16 {
        self.port
    }
}

/// Takes the lock of a port; `None` when another run has it.
fn lock(port: u16) -> Result<Option<UnixDatagram>, OpenError> {
    let locked = SocketAddr::from_abstract_name(format!("platoon-udp-{port}"))
        .and_then(|name| UnixDatagram::bind_addr(&name));
    match locked {
        Ok(lock) => Ok(Some(lock)),
        Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => Ok(None),
        Err(source) => {
            Err(OpenError::Os { what: format!("udp port {port}"), step: "lease it", source })
        }
    }
}

/// True when no other program holds the port for itself alone. Listeners such as python-can, which
/// share it as this bench does, are welcome.
fn is_sharable(port: u16) -> bool {
    let tried = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)
        .and_then(|socket| {
            sockopt::set_socket_reuseaddr(&socket, true)?;
            bind(&socket, &SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port))
        });
    tried.is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_takes_the_next_port_and_a_third_reuses_a_returned_one() {
        let first = PortLease::acquire(47_300).expect("some port is free");
        let second = PortLease::acquire(first.port()).expect("the next port is free");
        assert!(second.port() > first.port());
        let returned = first.port();
        drop(first);
        let third = PortLease::acquire(returned).expect("the port is free again");
        assert_eq!(third.port(), returned);
    }

    #[test]
    fn a_port_another_program_holds_alone_is_passed_over() {
        let holder = std::net::UdpSocket::bind("0.0.0.0:0").expect("a free port");
        let held = holder.local_addr().expect("bound").port();
        let lease = PortLease::acquire(held).expect("some port is free");
        assert_ne!(lease.port(), held);
    }
}
