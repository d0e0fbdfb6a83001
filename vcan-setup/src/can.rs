//! Virtual CAN interfaces: is there CAN in this kernel, and make the interfaces a rehearsal needs.
//!
//! An interface is touched only when it is a `vcan`; whatever else carries the name is refused.
//! What one call creates, and only that, a later [`remove_vcan`] takes away; [`remove_idle`] takes
//! away what nobody uses, whoever made it.

mod support;

use std::io;
use std::time::Duration;

use socketcan::CanInterface;
use socketcan::nl::Mtu;

use crate::host::Lack;
use crate::link::Link;
use crate::realtime::{CAP_NET_ADMIN, has_capability};

pub use support::{CanSupport, kernel_support};

/// Packet size \[bytes\] of a CAN FD frame (CANFD_MTU of linux/can.h).
const FD_MTU: u32 = 72;
/// Longest interface name \[bytes\] (IFNAMSIZ less its terminator).
const NAME_BYTES_MAX: usize = 15;
/// Tries at one interface before giving up; others may make or remove the same one.
const ATTEMPTS_MAX: usize = 64;

/// An interface that [`ensure_vcan`] made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Vcan {
    /// Its name.
    pub name: String,
    /// Its index: a later interface of the same name has another one.
    pub index: u32,
}

/// Whether an interface may lead out of this machine: it exists and is neither `vcan` nor `vxcan`.
///
/// One that cannot be asked about counts as physical: the safe side.
#[must_use]
pub fn may_be_physical(name: &str) -> bool {
    match Link::find(name) {
        Ok(Some(link)) => !matches!(link.kind.as_deref(), Some("vcan" | "vxcan")),
        Ok(None) => false,
        Err(_) => true,
    }
}

/// What [`ensure_vcan`] did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Created {
    /// Interfaces made by this call, to be given to [`remove_vcan`].
    pub created: Vec<Vcan>,
    /// Names that were FD-capable `vcan` interfaces already.
    pub reused: Vec<String>,
}

/// Why there is no virtual CAN interface. Every message ends with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum CanError {
    /// The kernel has no CAN for this process.
    #[error("virtual CAN: {0}")]
    NoCan(CanSupport),
    /// The name cannot be an interface's.
    #[error(
        "virtual CAN: {0:?} is not an interface name; 1 to 15 characters without blank, '/' or ':'"
    )]
    BadName(String),
    /// The name is taken by an interface of another kind.
    #[error(
        "virtual CAN: interface {name} exists and is of kind {kind}, not vcan; \
         choose another name"
    )]
    OtherKind {
        /// Name of the interface.
        name: String,
        /// Its kind.
        kind: String,
    },
    /// An interface in use carries classic frames only.
    #[error(
        "virtual CAN: {name} is up with MTU {mtu}, CAN FD needs {FD_MTU}; \
         `sudo ip link set {name} down; sudo ip link set {name} mtu {FD_MTU} up`"
    )]
    NotFd {
        /// Name of the interface.
        name: String,
        /// Its MTU \[bytes\].
        mtu: u32,
    },
    /// The process has no CAP_NET_ADMIN.
    #[error(
        "virtual CAN: creating {name} needs CAP_NET_ADMIN; run as root, or create it once: \
         `sudo ip link add {name} type vcan; sudo ip link set {name} mtu {FD_MTU} up`"
    )]
    NotPermitted {
        /// Name of the interface.
        name: String,
    },
    /// The process has no CAP_NET_ADMIN, and the interface is there.
    #[error(
        "virtual CAN: changing or removing {name} needs CAP_NET_ADMIN; run as root \
         (`sudo ip link delete {name}` removes it)"
    )]
    NotPermittedToChange {
        /// Name of the interface.
        name: String,
    },
    /// Somebody uses the interface.
    #[error(
        "virtual CAN: {name} carries traffic ({packets} frames within {} ms), so it stays; end the \
         program that sends (`candump {name}` shows what), then try again",
        watched.as_millis()
    )]
    Busy {
        /// Name of the interface.
        name: String,
        /// Frames seen.
        packets: u64,
        /// How long it was watched.
        watched: Duration,
    },
    /// The kernel refused to create the interface although the process may.
    #[error(
        "virtual CAN: the kernel makes no vcan interface {name} ({error}); `sudo modprobe vcan` \
         (Debian, Ubuntu: package linux-modules-extra-$(uname -r)); in a container, on the host"
    )]
    NoModule {
        /// Name of the interface.
        name: String,
        /// The system's own words.
        error: io::Error,
    },
    /// An interface could not be read, changed or removed.
    #[error("virtual CAN: {action} {name}: {error}; see `ip -details link show {name}`")]
    Netlink {
        /// What was tried.
        action: &'static str,
        /// Name of the interface.
        name: String,
        /// The system's own words.
        error: io::Error,
    },
}

impl CanError {
    /// What the machine lacks, when the remedy depends on the machine.
    #[must_use]
    pub fn lack(&self) -> Option<Lack> {
        match self {
            Self::NoCan(CanSupport::NotPermitted) => None,
            Self::NoCan(_) | Self::NoModule { .. } => Some(Lack::Can),
            Self::NotPermitted { .. } | Self::NotPermittedToChange { .. } => Some(Lack::NetAdmin),
            Self::BadName(_)
            | Self::OtherKind { .. }
            | Self::NotFd { .. }
            | Self::Busy { .. }
            | Self::Netlink { .. } => None,
        }
    }
}

/// Makes sure that every name is a `vcan` interface that carries CAN FD and is up.
///
/// Interfaces that are so already are left alone, so calling it twice, or from two processes at
/// once, is harmless. When one name fails, the interfaces made for the names before it are removed.
///
/// # Errors
/// [`CanError`], each variant with the remedy.
pub fn ensure_vcan(names: &[&str]) -> Result<Created, CanError> {
    for name in names {
        check_name(name)?;
    }
    let support = kernel_support();
    if !support.is_available() {
        return Err(CanError::NoCan(support));
    }
    let mut done = Created::default();
    for name in names {
        if let Err(error) = ensure_one(name, &mut done) {
            // Nothing half-made stays behind; the first error is the one worth reporting.
            let _ = remove_vcan(&done.created);
            return Err(error);
        }
    }
    Ok(done)
}

/// Removes interfaces made by [`ensure_vcan`]. One that is already gone, or was replaced by another
/// of the same name, is left alone.
///
/// # Errors
/// [`CanError::Netlink`] for the first interface that could not be removed; the others are removed
/// all the same.
pub fn remove_vcan(created: &[Vcan]) -> Result<(), CanError> {
    let mut first_error = Ok(());
    for vcan in created {
        let outcome = remove_one(vcan);
        first_error = first_error.and(outcome);
    }
    first_error
}

/// What [`remove_idle`] did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Removed {
    /// Names of the interfaces it removed.
    pub removed: Vec<String>,
    /// Names that no interface had.
    pub absent: Vec<String>,
}

/// Removes the `vcan` interfaces of these names unless one of them carries traffic, which is
/// looked for during `watch`. When one name is refused, nothing is removed.
///
/// # Errors
/// [`CanError`], each variant with the remedy.
pub fn remove_idle(names: &[&str], watch: Duration) -> Result<Removed, CanError> {
    let mut done = Removed::default();
    let mut found = Vec::new();
    for name in names {
        check_name(name)?;
        match find(name)? {
            Some(link) => {
                only_vcan(name, &link)?;
                found.push((*name, link));
            }
            None => done.absent.push((*name).into()),
        }
    }
    if !found.is_empty() {
        std::thread::sleep(watch);
    }
    for (name, before) in &found {
        let now = find(name)?.filter(|now| now.index == before.index);
        let packets = now.map_or(0, |now| now.packets.saturating_sub(before.packets));
        if packets > 0 {
            return Err(CanError::Busy { name: (*name).into(), packets, watched: watch });
        }
    }
    for (name, link) in found {
        remove_one(&Vcan { name: name.into(), index: link.index })?;
        done.removed.push(name.into());
    }
    Ok(done)
}

/// What an interface needs before frames can flow.
#[derive(Debug, PartialEq, Eq)]
enum Need {
    /// Nothing.
    Nothing,
    /// It exists, is down, and may be configured.
    Configuring,
}

/// Whether `link` is a `vcan` of use to us, and what it still needs.
fn judge(name: &str, link: &Link) -> Result<Need, CanError> {
    only_vcan(name, link)?;
    match (link.is_up, link.mtu >= FD_MTU) {
        (true, true) => Ok(Need::Nothing),
        (true, false) => Err(CanError::NotFd { name: name.into(), mtu: link.mtu }),
        (false, _) => Ok(Need::Configuring),
    }
}

/// Whether a link is a `vcan` that is fit for CAN FD, or can be made so.
pub(crate) fn fitness(name: &str, link: &Link) -> Result<(), CanError> {
    judge(name, link).map(|_| ())
}

/// Refuses every kind but `vcan`; no other is ever touched.
fn only_vcan(name: &str, link: &Link) -> Result<(), CanError> {
    match link.kind.as_deref().unwrap_or("hardware") {
        "vcan" => Ok(()),
        kind => Err(CanError::OtherKind { name: name.into(), kind: kind.into() }),
    }
}

/// Brings one interface about, looking again after each change because others may act meanwhile.
fn ensure_one(name: &str, done: &mut Created) -> Result<(), CanError> {
    let mut last = None;
    for _ in 0..ATTEMPTS_MAX {
        let Some(link) = find(name)? else {
            create(name, done)?;
            continue;
        };
        if judge(name, &link)? == Need::Nothing {
            if !done.created.iter().any(|vcan| vcan.name == name) {
                done.reused.push(name.into());
            }
            return Ok(());
        }
        last = configure(link.index).err();
        if last.is_some() && !has_capability(CAP_NET_ADMIN) {
            return Err(CanError::NotPermittedToChange { name: name.into() });
        }
    }
    let error = last.map_or_else(|| io::Error::other("it keeps disappearing"), io::Error::other);
    Err(CanError::Netlink { action: "configuring", name: name.into(), error })
}

/// Creates the interface and notes it as ours; one that another made meanwhile is theirs.
fn create(name: &str, done: &mut Created) -> Result<(), CanError> {
    match Link::create_vcan(name) {
        Ok(()) => {
            if let Ok(Some(link)) = Link::find(name) {
                done.created.push(Vcan { name: name.into(), index: link.index });
            }
            Ok(())
        }
        Err(error) if error.raw_os_error() == Some(libc::EEXIST) => Ok(()),
        Err(_) if !has_capability(CAP_NET_ADMIN) => {
            Err(CanError::NotPermitted { name: name.into() })
        }
        Err(error) => Err(CanError::NoModule { name: name.into(), error }),
    }
}

/// Gives a `vcan` that is down the FD packet size and brings it up.
fn configure(index: u32) -> Result<(), socketcan::Error> {
    let interface = CanInterface::open_iface(index);
    // The driver takes the packet size only while the interface is down.
    interface.set_mtu(Mtu::Fd)?;
    interface.bring_up()
}

/// Removes one interface if it is still the one we made.
fn remove_one(vcan: &Vcan) -> Result<(), CanError> {
    let still_ours = find(&vcan.name)?
        .is_some_and(|link| link.index == vcan.index && link.kind.as_deref() == Some("vcan"));
    if !still_ours {
        return Ok(());
    }
    let Err((_, error)) = CanInterface::open_iface(vcan.index).delete() else {
        return Ok(());
    };
    let name = vcan.name.clone();
    match find(&name)? {
        // Somebody else was faster.
        found if found.as_ref().is_none_or(|link| link.index != vcan.index) => Ok(()),
        _ if !has_capability(CAP_NET_ADMIN) => Err(CanError::NotPermittedToChange { name }),
        _ => {
            let error = io::Error::other(error);
            Err(CanError::Netlink { action: "removing", name, error })
        }
    }
}

/// Looks an interface up, with an error that names it.
fn find(name: &str) -> Result<Option<Link>, CanError> {
    let action = "reading";
    Link::find(name).map_err(|error| CanError::Netlink { action, name: name.into(), error })
}

/// The kernel's own rule for interface names (dev_valid_name).
fn check_name(name: &str) -> Result<(), CanError> {
    let length_ok = (1..=NAME_BYTES_MAX).contains(&name.len());
    let bytes_ok = name.bytes().all(|byte| byte.is_ascii_graphic() && !b"/:".contains(&byte));
    let ok = length_ok && bytes_ok && name != "." && name != "..";
    if ok { Ok(()) } else { Err(CanError::BadName(name.into())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(kind: Option<&str>, mtu: u32, is_up: bool) -> Link {
        Link { index: 7, kind: kind.map(Into::into), mtu, is_up, packets: 0 }
    }

    #[test]
    fn an_fd_vcan_that_is_up_needs_nothing() {
        assert_eq!(judge("truck0", &link(Some("vcan"), 72, true)).expect("usable"), Need::Nothing);
        assert_eq!(judge("truck0", &link(Some("vcan"), 2060, true)).expect("XL"), Need::Nothing);
    }

    #[test]
    fn a_vcan_that_is_down_may_be_configured() {
        for mtu in [16, 72] {
            let need = judge("truck0", &link(Some("vcan"), mtu, false)).expect("usable");
            assert_eq!(need, Need::Configuring);
        }
    }

    #[test]
    fn a_classic_vcan_in_use_is_refused_with_the_command_that_mends_it() {
        let error = judge("truck0", &link(Some("vcan"), 16, true)).expect_err("not FD");
        assert!(error.to_string().contains("ip link set truck0 mtu 72 up"), "{error}");
    }

    #[test]
    fn no_other_kind_of_interface_is_ever_taken() {
        for kind in [None, Some("can"), Some("vxcan"), Some("slcan"), Some("bridge")] {
            let error = judge("can0", &link(kind, 72, false)).expect_err("not a vcan");
            assert!(matches!(error, CanError::OtherKind { .. }), "{error}");
        }
    }

    #[test]
    fn names_the_kernel_would_refuse_are_refused_before_anything_is_made() {
        for name in ["", ".", "..", "a b", "a/b", "a:b", "sixteen-letters-", "träger", "a\0b"] {
            let error = ensure_vcan(&["truck0", name]).expect_err("bad name");
            assert!(matches!(error, CanError::BadName(_)), "{name:?}: {error}");
        }
        assert!(check_name("fifteen-letters").is_ok());
    }

    #[test]
    fn the_error_for_a_kernel_without_can_carries_the_remedy() {
        let error = CanError::NoCan(CanSupport::NoAddressFamily).to_string();
        assert!(error.starts_with("virtual CAN: the kernel has no CAN"), "{error}");
        assert!(error.contains("sudo modprobe -a can can_raw"), "{error}");
    }

    #[test]
    fn only_idle_vcan_interfaces_are_removed_by_name() {
        let watch = Duration::ZERO;
        let removed = remove_idle(&["no-such-link"], watch).expect("nothing to do");
        assert_eq!((removed.removed.len(), removed.absent), (0, vec!["no-such-link".into()]));
        let error = remove_idle(&["no-such-link", "lo"], watch).expect_err("lo is no vcan");
        assert!(matches!(error, CanError::OtherKind { .. }), "{error}");
        let error = remove_idle(&["a b"], watch).expect_err("no name");
        assert!(matches!(error, CanError::BadName(_)), "{error}");
    }

    #[test]
    fn removing_nothing_is_no_error() {
        remove_vcan(&[]).expect("nothing to do");
        remove_vcan(&[Vcan { name: "no-such-link".into(), index: 9 }]).expect("already gone");
    }

    #[test]
    fn an_interface_that_is_not_the_one_we_made_is_not_removed() {
        remove_vcan(&[Vcan { name: "lo".into(), index: 1 }]).expect("left alone");
        assert!(Link::find("lo").expect("netlink answers").is_some());
    }
}
