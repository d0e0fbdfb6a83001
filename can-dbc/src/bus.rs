//! The bus: one trait, three back-ends, and what can happen on any of them.

mod emulated;
mod kernel_socket;
mod loopback;
mod port_lease;
mod queueing;
mod socketcan;
mod udp;

pub use emulated::Emulated;
pub use loopback::Loopback;
pub use port_lease::PortLease;
pub use queueing::Queueing;
pub use socketcan::SocketCan;
pub use udp::{Udp, UdpOptions};

use crate::frame::Frame;
use core::time::Duration;
use std::net::Ipv4Addr;

/// Kind of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Backend {
    /// A CAN interface of the Linux kernel.
    Socketcan,
    /// UDP multicast on the loopback interface, in python-can's format.
    Udp,
    /// Queues in memory, for virtual time.
    Loopback,
}

/// A frame that was on the bus, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// The frame.
    pub frame: Frame,
    /// Kernel receive time, nanoseconds of CLOCK_REALTIME; on a loopback bus the sender's bench
    /// time. 0 when unknown.
    pub stamp_ns: u64,
    /// Whether this node sent the frame itself and now hears its echo; see [`Bus::echoes`].
    pub own: bool,
}

/// One node's attachment to one bus.
///
/// A node receives what it sent itself only where it asked for that (`with_echo` of the back-ends),
/// and then marked as its own. Apart from [`wait`](Self::wait), nothing blocks,
/// allocates or retries.
pub trait Bus: Send {
    /// Kind of the bus.
    fn backend(&self) -> Backend;

    /// Name for people: `truck0`, `udp:239.74.163.2:43113`, `loopback0`.
    fn name(&self) -> &str;

    /// Whether every frame sent is received again, as [`Received::own`], once it was on the bus:
    /// in the order of the bus and with its time.
    fn echoes(&self) -> bool {
        false
    }

    /// Hands a frame to the bus.
    ///
    /// # Errors
    /// Counted, and not retried: the next cycle has newer data.
    fn send(&mut self, frame: &Frame) -> Result<(), SendError>;

    /// The oldest frame waiting, or `None`. What cannot be a frame is counted and skipped.
    ///
    /// # Errors
    /// The bus itself failed.
    fn receive(&mut self) -> Result<Option<Received>, ReceiveError>;

    /// Blocks until something waits or the time is over; true when something waits.
    ///
    /// For start-up only. Something waiting may still turn out to be no frame.
    ///
    /// # Errors
    /// The bus itself failed.
    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError>;

    /// Totals so far.
    fn counts(&self) -> BusCounts;

    /// Tells the bench time, at which following frames are sent. To be called with times in order.
    ///
    /// A bus in virtual time stamps frames with it, and to an [`Emulated`] one it is the clock; the
    /// others have the kernel's.
    fn set_bench_time(&mut self, _time_ns: u64) {}

    /// Tells that the run begins, at bench time 0.
    fn begin(&mut self) {}

    /// Tells that the run is over and bench time stands still.
    fn end(&mut self) {}

    /// How long frames took on an [`Emulated`] bus since the run began, by identifier.
    fn queueing(&self) -> &[Queueing] {
        &[]
    }
}

impl<B: Bus + ?Sized> Bus for Box<B> {
    fn backend(&self) -> Backend {
        (**self).backend()
    }
    fn name(&self) -> &str {
        (**self).name()
    }
    fn echoes(&self) -> bool {
        (**self).echoes()
    }
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        (**self).send(frame)
    }
    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        (**self).receive()
    }
    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        (**self).wait(timeout)
    }
    fn counts(&self) -> BusCounts {
        (**self).counts()
    }
    fn set_bench_time(&mut self, time_ns: u64) {
        (**self).set_bench_time(time_ns);
    }
    fn begin(&mut self) {
        (**self).begin();
    }
    fn end(&mut self) {
        (**self).end();
    }
    fn queueing(&self) -> &[Queueing] {
        (**self).queueing()
    }
}

/// Totals of one attachment since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusCounts {
    /// Frames the bus took.
    pub sent: u64,
    /// Frames received from others, error frames not included.
    pub received: u64,
    /// Frames refused because the transmit queue was full.
    pub send_full: u64,
    /// Frames refused for another reason.
    pub send_failed: u64,
    /// Receive calls that failed.
    pub receive_failed: u64,
    /// Frames the kernel dropped because this node read too slowly.
    pub receive_overflow: u64,
    /// Datagrams that are no frame.
    pub malformed: u64,
    /// Datagrams from another machine, dropped.
    pub foreign: u64,
    /// Own frames that came back; passed on where [`Bus::echoes`], else dropped.
    pub own_echo: u64,
    /// Error frames, by kind.
    pub error_frames: ErrorFrameCounts,
}

/// Error frames by class (`linux/can/error.h`); one frame may belong to several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorFrameCounts {
    /// Error frames in total.
    pub total: u64,
    /// The driver gave up sending a frame.
    pub tx_timeout: u64,
    /// Arbitration was lost in one-shot mode.
    pub lost_arbitration: u64,
    /// Controller problem: overflow, warning or passive level.
    pub controller: u64,
    /// Protocol violation: bit, stuff, form.
    pub protocol: u64,
    /// Transceiver fault.
    pub transceiver: u64,
    /// No other node acknowledged.
    pub no_acknowledgement: u64,
    /// The controller left the bus.
    pub bus_off: u64,
    /// Bus error.
    pub bus_error: u64,
    /// The controller came back.
    pub restarted: u64,
}

/// Why a frame was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// The transmit queue is full.
    #[error("the transmit queue is full")]
    BufferFull,
    /// The interface is down, or the other end is gone.
    #[error("the bus is down")]
    Down,
    /// This bus has no such frames.
    #[error("this bus does not carry such a frame")]
    Unsupported,
    /// The operating system's error number.
    #[error("operating system error {0}")]
    Os(i32),
}

/// Why nothing could be received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReceiveError {
    /// The interface is down or gone.
    #[error("the bus is down")]
    Down,
    /// The operating system's error number.
    #[error("operating system error {0}")]
    Os(i32),
}

/// Why a bus could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The kernel has no CAN at all.
    #[error(
        "interface {interface}: this kernel has no CAN (socket family AF_CAN is not supported); \
         use the udp bus, or a kernel with the can-raw and vcan modules"
    )]
    NoKernelCan {
        /// Interface asked for.
        interface: String,
    },
    /// There is no interface of this name.
    #[error(
        "interface {interface}: there is none of this name; create a virtual one with \
         `sudo ip link add {interface} mtu 72 type vcan; sudo ip link set {interface} up`"
    )]
    NoInterface {
        /// Interface asked for.
        interface: String,
    },
    /// The interface's MTU is neither that of classic CAN nor that of CAN FD.
    #[error("interface {interface}: no CAN FD interface; name a vcan, vxcan or can one (MTU 72)")]
    NotCan {
        /// Interface asked for.
        interface: String,
    },
    /// The interface carries classic frames only.
    #[error(
        "interface {interface}: it carries classic frames only (MTU 16); set it down, \
         `ip link set {interface} mtu 72`, and up again"
    )]
    NotFd {
        /// Interface asked for.
        interface: String,
    },
    /// The interface is down.
    #[error("interface {interface}: it is down; `ip link set {interface} up`")]
    InterfaceDown {
        /// Interface asked for.
        interface: String,
    },
    /// The operating system forbids it.
    #[error("{what}: permission denied; run with the CAP_NET_RAW capability or as root")]
    Permission {
        /// What was opened.
        what: String,
    },
    /// The group is no multicast address.
    #[error("group {group}: not an IPv4 multicast address; use 224.0.0.0 to 239.255.255.255")]
    NotMulticast {
        /// Group asked for.
        group: Ipv4Addr,
    },
    /// Somebody else holds the port exclusively.
    #[error("udp port {port}: held by another program; choose another port")]
    PortBusy {
        /// Port asked for.
        port: u16,
    },
    /// Every port tried is leased.
    #[error(
        "udp ports {first} to {last}: all taken by other runs or programs; end one of them or \
         choose another first port"
    )]
    AllPortsLeased {
        /// First port tried.
        first: u16,
        /// Last port tried.
        last: u16,
    },
    /// The tag is too long for the datagrams.
    #[error("tag {tag}: longer than {max} bytes; choose a shorter one, such as truck0")]
    LongTag {
        /// Tag asked for.
        tag: String,
        /// Longest tag in bytes.
        max: usize,
    },
    /// Anything else the operating system said.
    #[error("{what}: cannot {step}: {source}")]
    Os {
        /// What was opened.
        what: String,
        /// The step that failed.
        step: &'static str,
        /// What the operating system said.
        source: std::io::Error,
    },
}

/// Sorts and counts what the operating system said to a send.
fn count_send_error(counts: &mut BusCounts, error: &std::io::Error) -> SendError {
    let code = error.raw_os_error().unwrap_or_default();
    match code {
        libc::ENOBUFS | libc::EAGAIN => {
            counts.send_full += 1;
            return SendError::BufferFull;
        }
        _ => counts.send_failed += 1,
    }
    match code {
        libc::ENETDOWN | libc::ENETUNREACH | libc::ENODEV | libc::ENXIO => SendError::Down,
        // What SocketCAN answers to an FD frame on an interface that turned classic.
        libc::EINVAL => SendError::Unsupported,
        _ => SendError::Os(code),
    }
}

/// Sorts and counts what the operating system said to a receive.
fn count_receive_error(counts: &mut BusCounts, error: &std::io::Error) -> ReceiveError {
    counts.receive_failed += 1;
    match error.raw_os_error().unwrap_or_default() {
        libc::ENETDOWN | libc::ENODEV | libc::ENXIO => ReceiveError::Down,
        code => ReceiveError::Os(code),
    }
}
