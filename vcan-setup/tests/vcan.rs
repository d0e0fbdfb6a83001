//! The interfaces of a real kernel: these tests create and remove `vcan` links, so they need a
//! kernel with CAN and the right to administer its network. `./test.sh` runs them where it can.

use socketcan::{CanInterface, nl::Mtu};
use vcan_setup::can::{self, CanError, ensure_vcan, remove_vcan};

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn interfaces_come_up_ready_for_can_fd_and_go_away_again() {
    assert!(can::kernel_support().is_available());
    let made = ensure_vcan(&["pt-a0", "pt-a1"]).expect("two fresh interfaces");
    assert_eq!(made.created.len(), 2);
    assert!(made.reused.is_empty());
    for name in ["pt-a0", "pt-a1"] {
        let details = CanInterface::open(name).and_then(|link| link.details()).expect("exists");
        assert!(details.is_up, "{name}");
        assert_eq!(details.mtu, Some(Mtu::Fd), "{name}");
    }
    remove_vcan(&made.created).expect("ours to remove");
    assert!(CanInterface::open("pt-a0").is_err());
    assert!(CanInterface::open("pt-a1").is_err());
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn the_second_call_reuses_what_the_first_made() {
    let first = ensure_vcan(&["pt-b0"]).expect("a fresh interface");
    let second = ensure_vcan(&["pt-b0"]).expect("the same interface");
    assert!(second.created.is_empty());
    assert_eq!(second.reused, ["pt-b0"]);
    remove_vcan(&second.created).expect("nothing to remove");
    assert!(CanInterface::open("pt-b0").is_ok(), "what another call made stays");
    remove_vcan(&first.created).expect("ours to remove");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn calls_at_the_same_time_end_with_one_interface_and_one_owner() {
    let owners: usize = std::thread::scope(|scope| {
        let race = || ensure_vcan(&["pt-c0"]).expect("no call fails").created;
        let calls: Vec<_> = (0..8).map(|_| scope.spawn(race)).collect();
        let made = calls.into_iter().map(|call| call.join().expect("no panic"));
        made.filter(|created| !created.is_empty()).count()
    });
    assert_eq!(owners, 1);
    CanInterface::open("pt-c0").expect("exists").delete().expect("removable");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn a_vcan_left_down_with_the_classic_mtu_is_made_fit() {
    let link = CanInterface::create_vcan("pt-d0", None).expect("a fresh interface");
    link.set_mtu(Mtu::Standard).expect("down, so it can change");
    assert_eq!(ensure_vcan(&["pt-d0"]).expect("fit now").reused, ["pt-d0"]);
    let details = link.details().expect("exists");
    assert_eq!((details.is_up, details.mtu), (true, Some(Mtu::Fd)));
    link.delete().expect("removable");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn a_classic_vcan_in_use_is_refused_and_left_as_it_is() {
    let link = CanInterface::create_vcan("pt-e0", None).expect("a fresh interface");
    link.set_mtu(Mtu::Standard).expect("down, so it can change");
    link.bring_up().expect("ours");
    let error = ensure_vcan(&["pt-e0"]).expect_err("not FD");
    assert!(matches!(error, CanError::NotFd { mtu: 16, .. }), "{error}");
    assert_eq!(link.details().expect("exists").mtu, Some(Mtu::Standard));
    link.delete().expect("removable");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn a_refused_name_leaves_nothing_of_the_others_behind() {
    let error = ensure_vcan(&["pt-f0", "lo"]).expect_err("lo is no vcan");
    assert!(matches!(error, CanError::OtherKind { .. }), "{error}");
    assert!(CanInterface::open("pt-f0").is_err(), "pt-f0 was removed again");
}
