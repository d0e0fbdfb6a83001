//! The interfaces of a real kernel: these tests create and remove `vcan` links, so they need a
//! kernel with CAN and the right to administer its network. `./test.sh` runs them where it can.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use socketcan::{CanFrame, CanInterface, CanSocket, EmbeddedFrame, Socket, StandardId, nl::Mtu};
use vcan_setup::can::{self, CanError, ensure_vcan, remove_idle, remove_vcan};

/// How long interfaces are watched for traffic here.
const WATCH: Duration = Duration::from_millis(100);

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

/// What of an interface nobody may change.
fn state(name: &str) -> (Option<u32>, bool, Option<Mtu>) {
    let details = CanInterface::open(name).and_then(|link| link.details()).expect("exists");
    (Some(details.index), details.is_up, details.mtu)
}

/// Sends on an interface until `body` has returned.
fn while_traffic_passes<T>(name: &str, body: impl FnOnce() -> T) -> T {
    let socket = CanSocket::open(name).expect("up");
    let id = StandardId::new(0x123).expect("small enough");
    let frame = CanFrame::new(id, &[1, 2, 3]).expect("short enough");
    let (sent, over) = (AtomicBool::new(false), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                socket.write_frame(&frame).expect("vcan takes it");
                sent.store(true, Ordering::Relaxed);
                thread::sleep(Duration::from_millis(1));
            }
        });
        while !sent.load(Ordering::Relaxed) {
            thread::yield_now();
        }
        let result = body();
        over.store(true, Ordering::Relaxed);
        result
    })
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn idle_interfaces_are_removed_whoever_made_them_and_twice_is_once() {
    ensure_vcan(&["pt-g0"]).expect("a fresh interface");
    CanInterface::create_vcan("pt-g1", None).expect("a fresh interface");
    let done = remove_idle(&["pt-g0", "pt-g1", "pt-g2"], WATCH).expect("idle");
    assert_eq!(
        (done.removed, done.absent),
        (vec!["pt-g0".to_owned(), "pt-g1".to_owned()], vec!["pt-g2".to_owned()])
    );
    let again = remove_idle(&["pt-g0", "pt-g1"], WATCH).expect("nothing to do");
    assert_eq!(again.absent.len(), 2);
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn no_other_kind_of_interface_of_that_name_is_changed_or_removed() {
    for kind in ["vxcan", "dummy"] {
        let name = format!("pt-h-{kind}");
        let link = CanInterface::create::<Option<u32>>(&name, None, kind)
            .unwrap_or_else(|error| panic!("the kernel makes no {kind}: {error}"));
        let index = link.details().expect("exists").index;
        let up = ensure_vcan(&["pt-h0", &name]).expect_err("another kind");
        let down = remove_idle(&["pt-h0", &name], WATCH).expect_err("another kind");
        for error in [up, down] {
            let named = matches!(&error, CanError::OtherKind { kind: found, .. } if found == kind);
            assert!(named, "{error}");
        }
        let after = CanInterface::open(&name).and_then(|link| link.details()).expect("there");
        assert_eq!((after.index, after.is_up), (index, false), "{kind}");
        link.delete().expect("removable");
    }
    assert!(CanInterface::open("pt-h0").is_err(), "nothing half-made is left");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn an_interface_with_traffic_stays_as_it_is_and_keeps_the_others() {
    let made = ensure_vcan(&["pt-i0", "pt-i1"]).expect("fresh interfaces").created;
    let before = state("pt-i0");
    while_traffic_passes("pt-i0", || {
        assert_eq!(ensure_vcan(&["pt-i0"]).expect("fit already").reused, ["pt-i0"]);
        let error = remove_idle(&["pt-i1", "pt-i0"], WATCH).expect_err("in use");
        assert!(matches!(&error, CanError::Busy { name, .. } if name == "pt-i0"), "{error}");
        assert_eq!(state("pt-i0"), before);
        assert!(CanInterface::open("pt-i1").is_ok(), "all or nothing");
    });
    remove_vcan(&made).expect("ours to remove");
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn making_and_removing_at_the_same_time_fails_for_nobody() {
    let names = ["pt-j0", "pt-j1"];
    thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                for _ in 0..20 {
                    ensure_vcan(&names).expect("up against up and down");
                }
            });
            scope.spawn(|| {
                for _ in 0..20 {
                    remove_idle(&names, Duration::ZERO).expect("down against up and down");
                }
            });
        }
    });
    ensure_vcan(&names).expect("there at last");
    assert_eq!(remove_idle(&names, Duration::ZERO).expect("idle").removed, names);
}
