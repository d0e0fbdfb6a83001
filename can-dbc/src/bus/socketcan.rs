//! The real bus: a CAN FD interface of the Linux kernel (vcan, vxcan or hardware).
//!
//! The `socketcan` crate opens and configures the socket. Frames are read and written here, in the
//! kernel's own layout (`struct can_frame` and `struct canfd_frame` of `linux/can.h`), because the
//! receive time and the overflow count must come with the same system call as the frame.

use super::SendError;
use super::kernel_socket::{self, Arrival, DropCounter};
use super::{Backend, Bus, BusCounts, ErrorFrameCounts, OpenError, ReceiveError, Received};
use crate::frame::{Frame, FrameFlags};
use crate::probe;
use core::time::Duration;
use rustix::fd::AsFd;
use socketcan::nl::Mtu;
use socketcan::{CanFdSocket, CanInterface, Socket as _, SocketOptions as _};
use std::io;

/// Sizes of `struct can_frame` and `struct canfd_frame`, which tell one from the other.
const CLASSIC_SIZE: usize = 16;
const FD_SIZE: usize = 72;
/// Offset of the data in both.
const DATA: usize = 8;

/// Flags in the identifier word.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
/// Flags in byte 5 of an FD frame.
const BRS: u8 = 0x01;
const ESI: u8 = 0x02;

/// A node on a CAN interface.
#[derive(Debug)]
pub struct SocketCan {
    name: String,
    socket: CanFdSocket,
    echoes: bool,
    drops: DropCounter,
    counts: BusCounts,
}

impl SocketCan {
    /// Opens a CAN FD interface that is up, for all traffic including error frames.
    ///
    /// # Errors
    /// [`OpenError`] naming the interface and the remedy.
    pub fn open(interface: &str) -> Result<Self, OpenError> {
        let name = interface.to_owned();
        if !probe::kernel_has_can() {
            return Err(OpenError::NoKernelCan { interface: name });
        }
        check_interface(interface)?;
        let failed = |step| {
            let what = format!("interface {interface}");
            move |source: io::Error| open_error(what, step, source)
        };
        let socket = CanFdSocket::open(interface).map_err(failed("open it"))?;
        socket.set_nonblocking(true).map_err(failed("make it non-blocking"))?;
        socket.set_error_filter_accept_all().map_err(failed("ask for error frames"))?;
        kernel_socket::prepare(socket.as_fd()).map_err(failed("ask for receive times"))?;
        let (drops, counts) = (DropCounter::default(), BusCounts::default());
        Ok(Self { name, socket, echoes: false, drops, counts })
    }

    /// Hears its own frames too: on vcan at once, on hardware when they have been transmitted.
    ///
    /// # Errors
    /// [`OpenError`] naming the interface, when the kernel refuses.
    pub fn with_echo(mut self) -> Result<Self, OpenError> {
        let refused = |source| {
            open_error(format!("interface {}", self.name), "ask for its own frames", source)
        };
        self.socket.set_recv_own_msgs(true).map_err(refused)?;
        self.echoes = true;
        Ok(self)
    }

    fn accept(&mut self, arrival: &Arrival, bytes: &[u8; FD_SIZE]) -> Option<Received> {
        self.counts.receive_overflow += self.drops.advance(arrival);
        let Some(frame) = parse(&bytes[..arrival.length]) else {
            self.counts.malformed += 1;
            return None;
        };
        if frame.flags().is_error {
            count_error_frame(&mut self.counts.error_frames, frame.id());
        } else if arrival.is_own {
            self.counts.own_echo += 1;
        } else {
            self.counts.received += 1;
        }
        Some(Received { frame, stamp_ns: arrival.stamp_ns, own: arrival.is_own })
    }
}

impl Bus for SocketCan {
    fn backend(&self) -> Backend {
        Backend::Socketcan
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn echoes(&self) -> bool {
        self.echoes
    }

    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if frame.flags().is_error {
            self.counts.send_failed += 1;
            return Err(SendError::Unsupported);
        }
        let bytes = layout(frame);
        let size = if frame.flags().is_fd { FD_SIZE } else { CLASSIC_SIZE };
        match rustix::io::write(&self.socket, &bytes[..size]) {
            Ok(_) => {
                self.counts.sent += 1;
                Ok(())
            }
            Err(error) => Err(super::count_send_error(&mut self.counts, &error.into())),
        }
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        let mut bytes = [0; FD_SIZE];
        match kernel_socket::receive(self.socket.as_fd(), &mut bytes) {
            Ok(None) => Ok(None),
            Ok(Some(arrival)) => Ok(self.accept(&arrival, &bytes)),
            Err(error) => Err(super::count_receive_error(&mut self.counts, &error)),
        }
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        kernel_socket::wait(self.socket.as_fd(), timeout)
    }

    fn counts(&self) -> BusCounts {
        self.counts
    }
}

/// Says what is wrong with the interface before the socket only says "invalid".
fn check_interface(interface: &str) -> Result<(), OpenError> {
    let name = || interface.to_owned();
    let found =
        CanInterface::open(interface).map_err(|_| OpenError::NoInterface { interface: name() })?;
    let details = found.details().map_err(|error| OpenError::Os {
        what: format!("interface {interface}"),
        step: "read its state over netlink",
        source: io::Error::other(error),
    })?;
    match details.mtu {
        None => Err(OpenError::NotCan { interface: name() }),
        Some(Mtu::Standard) => Err(OpenError::NotFd { interface: name() }),
        Some(Mtu::Fd) if !details.is_up => Err(OpenError::InterfaceDown { interface: name() }),
        Some(Mtu::Fd) => Ok(()),
    }
}

fn open_error(what: String, step: &'static str, source: io::Error) -> OpenError {
    if source.kind() == io::ErrorKind::PermissionDenied {
        return OpenError::Permission { what };
    }
    OpenError::Os { what, step, source }
}

/// A frame in the kernel's layout.
fn layout(frame: &Frame) -> [u8; FD_SIZE] {
    let flags = frame.flags();
    let word = frame.id()
        | if flags.is_extended { EXTENDED } else { 0 }
        | if flags.is_rtr { REMOTE } else { 0 };
    let mut bytes = [0; FD_SIZE];
    bytes[..4].copy_from_slice(&word.to_ne_bytes());
    bytes[4] = frame.length() as u8;
    bytes[5] = if flags.brs { BRS } else { 0 } | if flags.esi { ESI } else { 0 };
    bytes[DATA..DATA + frame.data().len()].copy_from_slice(frame.data());
    bytes
}

/// A frame from the kernel's layout; `None` for what is neither a classic nor an FD frame.
fn parse(bytes: &[u8]) -> Option<Frame> {
    let is_fd = match bytes.len() {
        CLASSIC_SIZE => false,
        FD_SIZE => true,
        _ => return None,
    };
    let word = u32::from_ne_bytes(*bytes.first_chunk()?);
    let is_error = word & ERROR != 0;
    let flags = FrameFlags {
        is_extended: !is_error && word & EXTENDED != 0,
        is_fd,
        brs: is_fd && bytes[5] & BRS != 0,
        esi: is_fd && bytes[5] & ESI != 0,
        is_rtr: !is_error && word & REMOTE != 0,
        is_error,
    };
    let length = usize::from(bytes[4]);
    let data = if flags.is_rtr { &[] } else { bytes.get(DATA..DATA + length)? };
    Frame::build(word & !(EXTENDED | REMOTE | ERROR), flags, length, data).ok()
}

/// The classes of `linux/can/error.h`, one bit each.
fn count_error_frame(counts: &mut ErrorFrameCounts, classes: u32) {
    let has = |class: u32| u64::from(classes & class != 0);
    counts.total += 1;
    counts.tx_timeout += has(0x001);
    counts.lost_arbitration += has(0x002);
    counts.controller += has(0x004);
    counts.protocol += has(0x008);
    counts.transceiver += has(0x010);
    counts.no_acknowledgement += has(0x020);
    counts.bus_off += has(0x040);
    counts.bus_error += has(0x080);
    counts.restarted += has(0x100);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_layout_round_trips() {
        let fd = FrameFlags {
            is_extended: true,
            is_fd: true,
            brs: true,
            esi: true,
            ..FrameFlags::default()
        };
        let sent = Frame::new(0x18FF_1080, fd, &[0xA5; 64]).expect("valid");
        assert_eq!(parse(&layout(&sent)), Some(sent));
        let classic = Frame::new(0x123, FrameFlags::default(), &[1, 2, 3]).expect("valid");
        assert_eq!(parse(&layout(&classic)[..CLASSIC_SIZE]), Some(classic));
        let remote = Frame::remote(0x7FF, false, 8).expect("valid");
        assert_eq!(parse(&layout(&remote)[..CLASSIC_SIZE]), Some(remote));
    }

    #[test]
    fn what_the_kernel_never_sends_is_no_frame() {
        let mut bytes = [0; FD_SIZE];
        assert_eq!(parse(&bytes[..40]), None);
        bytes[4] = 200;
        assert_eq!(parse(&bytes), None);
        assert_eq!(parse(&bytes[..CLASSIC_SIZE]), None);
    }

    #[test]
    fn an_error_frame_counts_for_each_of_its_classes() {
        let mut bytes = [0; CLASSIC_SIZE];
        bytes[..4].copy_from_slice(&(ERROR | 0x044_u32).to_ne_bytes());
        bytes[4] = 8;
        let frame = parse(&bytes).expect("an error frame");
        assert!(frame.flags().is_error);
        let mut counts = ErrorFrameCounts::default();
        count_error_frame(&mut counts, frame.id());
        assert_eq!((counts.total, counts.controller, counts.bus_off), (1, 1, 1));
        assert_eq!(counts.protocol, 0);
    }

    #[test]
    fn an_interface_that_does_not_exist_is_refused_by_name() {
        let refused = SocketCan::open("nosuchcan9").expect_err("there is none");
        assert!(refused.to_string().contains("nosuchcan9"));
    }
}
