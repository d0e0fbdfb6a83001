//! What both kernel buses need of their sockets: receive time, drop count, waiting.
//!
//! The only file of the crate with `unsafe`: the kernel hands time and drop count over as control
//! messages of `recvmsg`, for which no safe wrapper exists.

use super::ReceiveError;
use core::time::Duration;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, AsRawFd, BorrowedFd};
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};

/// Receive buffer asked of the kernel: about a second of one bus at 1 kHz.
const RECEIVE_BUFFER_BYTES: usize = 4 << 20;
/// Room for two control messages, in words to align it for `cmsghdr`.
const CONTROL_WORDS: usize = 16;
const NS_PER_S: u64 = 1_000_000_000;

/// What the kernel says about one received datagram or frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Arrival {
    /// Bytes written to the buffer.
    pub(super) length: usize,
    /// The datagram was longer than the buffer.
    pub(super) is_truncated: bool,
    /// This very socket sent the frame (SocketCAN only).
    pub(super) is_own: bool,
    /// Sender, for IPv4 sockets.
    pub(super) sender: Option<SocketAddrV4>,
    /// CLOCK_REALTIME at reception; 0 when the kernel gave none.
    pub(super) stamp_ns: u64,
    /// Frames this socket has lost so far, modulo 2^32; absent while there are none.
    pub(super) dropped: Option<u32>,
}

/// Extends the kernel's 32-bit drop count of a socket.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DropCounter {
    last: u32,
}

impl DropCounter {
    /// Frames lost since the arrival before.
    pub(super) fn advance(&mut self, arrival: &Arrival) -> u64 {
        let Some(dropped) = arrival.dropped else {
            return 0;
        };
        let new = dropped.wrapping_sub(self.last);
        self.last = dropped;
        u64::from(new)
    }
}

/// Asks for receive times, drop counts and a large receive buffer.
pub(super) fn prepare(socket: BorrowedFd<'_>) -> io::Result<()> {
    set_flag(socket, libc::SO_TIMESTAMPNS)?;
    set_flag(socket, libc::SO_RXQ_OVFL)?;
    use rustix::net::sockopt;
    // Beyond the system's limit only with CAP_NET_ADMIN; without it, as much as there is.
    if sockopt::set_socket_recv_buffer_size_force(socket, RECEIVE_BUFFER_BYTES).is_err() {
        sockopt::set_socket_recv_buffer_size(socket, RECEIVE_BUFFER_BYTES)?;
    }
    Ok(())
}

/// Blocks until the socket is readable or the timeout is over; true when it is readable.
pub(super) fn wait(socket: BorrowedFd<'_>, timeout: Duration) -> Result<bool, ReceiveError> {
    let timeout = Timespec::try_from(timeout).unwrap_or(Timespec { tv_sec: i64::MAX, tv_nsec: 0 });
    let mut sockets = [PollFd::new(&socket, PollFlags::IN)];
    match poll(&mut sockets, Some(&timeout)) {
        // A signal ends the wait early; the caller looks at its own reason to stop.
        Ok(0) | Err(rustix::io::Errno::INTR) => Ok(false),
        Ok(_) => Ok(true),
        Err(error) => Err(ReceiveError::Os(error.raw_os_error())),
    }
}

#[expect(unsafe_code, reason = "rustix has no setter for these two socket options")]
fn set_flag(socket: BorrowedFd<'_>, option: libc::c_int) -> io::Result<()> {
    let on: libc::c_int = 1;
    // SAFETY: the pointer and the length describe `on`, which outlives the call.
    let result = unsafe {
        libc::setsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            option,
            (&raw const on).cast(),
            size_of_val(&on) as libc::socklen_t,
        )
    };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Takes one datagram or frame without blocking; `None` when nothing waits.
#[expect(unsafe_code, reason = "rustix does not read these control messages")]
pub(super) fn receive(socket: BorrowedFd<'_>, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
    let mut control = [0_u64; CONTROL_WORDS];
    let mut part = libc::iovec { iov_base: buffer.as_mut_ptr().cast(), iov_len: buffer.len() };
    // SAFETY: both are plain C structs for which all zeros is a value.
    let (mut sender, mut message): (libc::sockaddr_in, libc::msghdr) =
        unsafe { (std::mem::zeroed(), std::mem::zeroed()) };
    message.msg_name = (&raw mut sender).cast();
    message.msg_namelen = size_of_val(&sender) as libc::socklen_t;
    message.msg_iov = &raw mut part;
    message.msg_iovlen = 1;
    message.msg_control = control.as_mut_ptr().cast();
    message.msg_controllen = size_of_val(&control) as _;
    // SAFETY: every pointer in `message` is to a live local or to `buffer`, with its true length.
    let length = unsafe { libc::recvmsg(socket.as_raw_fd(), &raw mut message, libc::MSG_DONTWAIT) };
    let Ok(length) = usize::try_from(length) else {
        let error = io::Error::last_os_error();
        let nothing =
            matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted);
        return if nothing { Ok(None) } else { Err(error) };
    };
    let mut arrival = Arrival {
        length,
        is_truncated: message.msg_flags & libc::MSG_TRUNC != 0,
        is_own: message.msg_flags & libc::MSG_CONFIRM != 0,
        sender: ipv4(&sender),
        ..Arrival::default()
    };
    // SAFETY: the kernel has just filled `message`, and `control` is still alive.
    unsafe { read_control(&message, &mut arrival) };
    Ok(Some(arrival))
}

/// Reads receive time and drop count.
///
/// # Safety
/// `message` is as `recvmsg` left it and its control buffer is alive.
#[expect(unsafe_code, reason = "control messages are reached through pointers")]
unsafe fn read_control(message: &libc::msghdr, arrival: &mut Arrival) {
    // SAFETY: the CMSG macros stay within the control buffer, whose length the kernel has set.
    let mut next = unsafe { libc::CMSG_FIRSTHDR(message) };
    while !next.is_null() {
        // SAFETY: a header returned by the CMSG macros is valid and aligned.
        let (level, kind, data) =
            unsafe { ((*next).cmsg_level, (*next).cmsg_type, libc::CMSG_DATA(next)) };
        match (level, kind) {
            (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                // SAFETY: this kind of message holds one `timespec`.
                let time = unsafe { data.cast::<libc::timespec>().read_unaligned() };
                let (seconds, ns) = (time.tv_sec.max(0) as u64, time.tv_nsec.max(0) as u64);
                arrival.stamp_ns = seconds.saturating_mul(NS_PER_S).saturating_add(ns);
            }
            (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) => {
                // SAFETY: this kind of message holds one 32-bit number.
                arrival.dropped = Some(unsafe { data.cast::<u32>().read_unaligned() });
            }
            _ => {}
        }
        // SAFETY: as for the first header.
        next = unsafe { libc::CMSG_NXTHDR(message, next) };
    }
}

fn ipv4(address: &libc::sockaddr_in) -> Option<SocketAddrV4> {
    if i32::from(address.sin_family) != libc::AF_INET {
        return None;
    }
    let ip = Ipv4Addr::from(address.sin_addr.s_addr.to_ne_bytes());
    Some(SocketAddrV4::new(ip, u16::from_be(address.sin_port)))
}
