//! One network interface over rtnetlink: kind, MTU, state, and making a `vcan`.
//!
//! The `socketcan` crate changes interfaces but does not tell a `vcan` from another kind, and
//! nothing may be touched before that is known; nor does it tell why one could not be made.

use std::ffi::CStr;
use std::io;

use neli::consts::nl::NlmF;
use neli::consts::rtnl::{Iff, Ifla, IflaInfo, RtAddrFamily, Rtm};
use neli::consts::socket::NlFamily;
use neli::nl::{NlPayload, Nlmsghdr, NlmsghdrBuilder};
use neli::rtnl::{Ifinfomsg, IfinfomsgBuilder, Rtattr, RtattrBuilder};
use neli::socket::synchronous::NlSocketHandle;
use neli::types::{Buffer, RtBuffer};
use neli::utils::Groups;

/// A network interface as the kernel describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Link {
    /// Interface index, unique until the next boot.
    pub(crate) index: u32,
    /// Kind as in `ip link add type KIND`; `None` for hardware and the loopback device.
    pub(crate) kind: Option<String>,
    /// Largest packet \[bytes\]; 72 and more carries CAN FD frames.
    pub(crate) mtu: u32,
    /// Whether the interface is up.
    pub(crate) is_up: bool,
    /// Packets that have passed it since it was made, in both directions.
    pub(crate) packets: u64,
}

impl Link {
    /// Looks an interface up by name; `None` when there is none of that name.
    pub(crate) fn find(name: &str) -> io::Result<Option<Self>> {
        match ask(&query(name)?) {
            Ok(reply) => Ok(reply.get_payload().map(Self::from_message)),
            Err(error) if error.raw_os_error() == Some(libc::ENODEV) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Makes an interface of kind `vcan`, down.
    ///
    /// # Errors
    /// The kernel's own errno: `EEXIST` for a name that is taken, `EPERM` without CAP_NET_ADMIN,
    /// `EOPNOTSUPP` when it has no driver for `vcan`.
    pub(crate) fn create_vcan(name: &str) -> io::Result<()> {
        ask(&creation(name)?).map(|_| ())
    }

    fn from_message(message: &Ifinfomsg) -> Self {
        let attributes = message.rtattrs().get_attr_handle();
        let kind =
            attributes.get_nested_attributes::<IflaInfo>(Ifla::Linkinfo).ok().and_then(|info| {
                let kind = info.get_attribute(IflaInfo::Kind)?.rta_payload().as_ref().to_vec();
                Some(until_nul(&kind))
            });
        Self {
            index: (*message.ifi_index()).unsigned_abs(),
            kind,
            mtu: attributes.get_attr_payload_as::<u32>(Ifla::Mtu).unwrap_or(0),
            is_up: message.ifi_flags().contains(Iff::UP),
            packets: attributes
                .get_attribute(Ifla::Stats64)
                .map_or(0, |stats| packets(stats.rta_payload().as_ref())),
        }
    }
}

/// Sends a request and waits for the kernel's answer to it; a refusal is its errno.
fn ask(request: &Nlmsghdr<Rtm, Ifinfomsg>) -> io::Result<Nlmsghdr<Rtm, Ifinfomsg>> {
    let socket = NlSocketHandle::connect(NlFamily::Route, None, Groups::empty())
        .map_err(io::Error::other)?;
    socket.send(request).map_err(io::Error::other)?;
    let (mut replies, _) = socket.recv::<Rtm, Ifinfomsg>().map_err(io::Error::other)?;
    let Some(reply) = replies.next().transpose().map_err(io::Error::other)? else {
        return Err(io::Error::other("no answer over netlink"));
    };
    match reply.nl_payload() {
        NlPayload::Err(error) => Err(io::Error::from_raw_os_error(-*error.error())),
        _ => Ok(reply),
    }
}

/// The request for one interface by name.
fn query(name: &str) -> io::Result<Nlmsghdr<Rtm, Ifinfomsg>> {
    let mut attributes = RtBuffer::new();
    attributes.push(named(name)?);
    request(Rtm::Getlink, NlmF::REQUEST, attributes)
}

/// The request to make an interface of kind `vcan`, unless the name is taken.
fn creation(name: &str) -> io::Result<Nlmsghdr<Rtm, Ifinfomsg>> {
    let kind = RtattrBuilder::default()
        .rta_type(IflaInfo::Kind)
        .rta_payload("vcan")
        .build()
        .map_err(io::Error::other)?;
    let info = RtattrBuilder::default()
        .rta_type(Ifla::Linkinfo)
        .rta_payload(Vec::<u8>::new())
        .build()
        .map_err(io::Error::other)?
        .nest(&kind)
        .map_err(io::Error::other)?;
    let mut attributes = RtBuffer::new();
    attributes.push(named(name)?);
    attributes.push(info);
    let flags = NlmF::REQUEST | NlmF::ACK | NlmF::CREATE | NlmF::EXCL;
    request(Rtm::Newlink, flags, attributes)
}

/// The attribute that names an interface.
fn named(name: &str) -> io::Result<Rtattr<Ifla, Buffer>> {
    RtattrBuilder::default()
        .rta_type(Ifla::Ifname)
        .rta_payload(name)
        .build()
        .map_err(io::Error::other)
}

/// A message about one interface.
fn request(
    action: Rtm,
    flags: NlmF,
    attributes: RtBuffer<Ifla, Buffer>,
) -> io::Result<Nlmsghdr<Rtm, Ifinfomsg>> {
    let message = IfinfomsgBuilder::default()
        .ifi_family(RtAddrFamily::Unspecified)
        .rtattrs(attributes)
        .build()
        .map_err(io::Error::other)?;
    NlmsghdrBuilder::default()
        .nl_type(action)
        .nl_flags(flags)
        .nl_payload(NlPayload::Payload(message))
        .build()
        .map_err(io::Error::other)
}

/// Received and sent packets, the first two numbers of `struct rtnl_link_stats64`
/// (linux/if_link.h).
fn packets(stats: &[u8]) -> u64 {
    let numbers = stats.chunks_exact(8).take(2);
    numbers.filter_map(|bytes| Some(u64::from_ne_bytes(*bytes.first_chunk()?))).sum()
}

/// Text of a netlink string, which the kernel pads with zeros.
fn until_nul(bytes: &[u8]) -> String {
    let text = CStr::from_bytes_until_nul(bytes).map_or(bytes, CStr::to_bytes);
    String::from_utf8_lossy(text).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loopback_device_has_an_index_and_no_kind() {
        let lo = Link::find("lo").expect("netlink answers").expect("every Linux has lo");
        assert_eq!((lo.index, lo.kind), (1, None));
        assert!(lo.mtu > 0);
    }

    #[test]
    fn an_interface_that_does_not_exist_is_not_an_error() {
        assert_eq!(Link::find("no-such-link").expect("netlink answers"), None);
    }

    #[test]
    fn a_name_that_is_taken_is_told_from_what_the_kernel_cannot_make() {
        let error = Link::create_vcan("lo").expect_err("lo is always there");
        let errno = error.raw_os_error();
        assert!(matches!(errno, Some(libc::EEXIST | libc::EPERM)), "{error}");
    }

    #[test]
    fn packets_of_both_directions_count_and_nothing_after_them() {
        let stats: Vec<u8> = [3_u64, 4, 1000, 1000].iter().flat_map(|n| n.to_ne_bytes()).collect();
        assert_eq!(packets(&stats), 7);
        assert_eq!(packets(&[]), 0);
    }

    #[test]
    fn kernel_strings_end_at_their_first_zero() {
        assert_eq!(until_nul(b"vcan\0\0"), "vcan");
        assert_eq!(until_nul(b"vcan"), "vcan");
    }
}
