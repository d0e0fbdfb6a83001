//! What the running kernel offers.

use rustix::net::{AddressFamily, SocketFlags, SocketType, socket_with};

/// True when the kernel can open raw CAN sockets.
///
/// The probe opens one and closes it again. Looking for an interface instead would answer "no such
/// device" on a kernel without CAN, and send the reader after the wrong remedy.
pub fn kernel_has_can() -> bool {
    // CAN_RAW is protocol 1 of the family (linux/can.h).
    let raw = std::num::NonZeroU32::new(1).map(rustix::net::Protocol::from_raw);
    let can = AddressFamily::from_raw(libc::AF_CAN as u16);
    let result = socket_with(can, SocketType::RAW, SocketFlags::CLOEXEC, raw);
    !matches!(result, Err(rustix::io::Errno::AFNOSUPPORT | rustix::io::Errno::PROTONOSUPPORT))
}
