//! Whether this kernel has CAN for this process.

use std::io;

use rustix::net::{AddressFamily, Protocol, SocketFlags, SocketType, socket_with};

/// CAN_RAW of linux/can.h.
const CAN_RAW: u32 = 1;

/// Whether this kernel offers CAN sockets to this process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CanSupport {
    /// A raw CAN socket can be opened.
    Available,
    /// The kernel knows no CAN address family: built without it, or the module is not loaded and
    /// cannot be.
    NoAddressFamily,
    /// CAN is there but its raw protocol is not.
    NoRawProtocol,
    /// The process may not open CAN sockets (a container's seccomp profile does this).
    NotPermitted,
    /// Another refusal, by its errno.
    Refused(i32),
}

impl CanSupport {
    /// Whether CAN sockets work.
    #[must_use]
    pub fn is_available(self) -> bool {
        self == Self::Available
    }
}

impl std::fmt::Display for CanSupport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Available => f.write_str("the kernel has CAN"),
            Self::NoAddressFamily => f.write_str(
                "the kernel has no CAN (EAFNOSUPPORT); `sudo modprobe -a can can_raw`, or a kernel \
                 built with CONFIG_CAN; in a container, on the host",
            ),
            Self::NoRawProtocol => {
                f.write_str("the kernel has CAN without raw sockets; `sudo modprobe can_raw`")
            }
            Self::NotPermitted => f.write_str(
                "this process may not open CAN sockets; allow AF_CAN in its seccomp profile",
            ),
            Self::Refused(errno) => {
                let error = io::Error::from_raw_os_error(*errno);
                write!(f, "the kernel refuses CAN sockets: {error}; see `dmesg`")
            }
        }
    }
}

/// Opens and closes a raw CAN socket to see whether this kernel has CAN.
#[must_use]
pub fn kernel_support() -> CanSupport {
    let protocol = rustix::net::RawProtocol::new(CAN_RAW).map(Protocol::from_raw);
    let flags = SocketFlags::CLOEXEC;
    match socket_with(AddressFamily::CAN, SocketType::RAW, flags, protocol) {
        Ok(_) => CanSupport::Available,
        Err(error) => classify(error.raw_os_error()),
    }
}

/// What an errno of socket(2) says about CAN.
fn classify(errno: i32) -> CanSupport {
    match errno {
        libc::EAFNOSUPPORT => CanSupport::NoAddressFamily,
        libc::EPROTONOSUPPORT => CanSupport::NoRawProtocol,
        libc::EPERM | libc::EACCES => CanSupport::NotPermitted,
        other => CanSupport::Refused(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_errno_of_the_probe_has_its_own_remedy() {
        assert_eq!(classify(libc::EAFNOSUPPORT), CanSupport::NoAddressFamily);
        assert_eq!(classify(libc::EPROTONOSUPPORT), CanSupport::NoRawProtocol);
        assert_eq!(classify(libc::EPERM), CanSupport::NotPermitted);
        assert_eq!(classify(libc::ENOMEM), CanSupport::Refused(libc::ENOMEM));
        assert!(CanSupport::NoAddressFamily.to_string().contains("modprobe -a can"));
    }
}
