//! The beacon by which socketcand's clients find a server: SavvyCAN knows no other way.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::interval;

/// Where clients listen.
const PORT: u16 = 42_000;
/// Time between beacons: the reference allows three seconds.
const PERIOD: Duration = Duration::from_secs(2);

/// Says where the gateway is and what buses it has, until dropped.
pub(super) async fn send(gateway: SocketAddr, names: &[String]) {
    let SocketAddr::V4(gateway) = gateway else { return };
    let text = text(gateway, names);
    let Ok(socket) = UdpSocket::bind((*gateway.ip(), 0)).await else { return };
    if socket.set_broadcast(true).is_err() {
        return;
    }
    let mut due = interval(PERIOD);
    loop {
        due.tick().await;
        // Nobody may be there to hear it, and a network may forbid it.
        let _ = socket.send_to(text.as_bytes(), audience(*gateway.ip())).await;
    }
}

/// This machine alone for a gateway on the loopback interface, else the local network.
fn audience(ip: Ipv4Addr) -> SocketAddrV4 {
    let everybody =
        if ip.is_loopback() { Ipv4Addr::new(127, 255, 255, 255) } else { Ipv4Addr::BROADCAST };
    SocketAddrV4::new(everybody, PORT)
}

fn text(gateway: SocketAddrV4, names: &[String]) -> String {
    let buses: String = names.iter().map(|name| format!("<Bus name=\"{name}\"/>")).collect();
    format!(
        "<CANBeacon name=\"platoon\" type=\"SocketCAN\" description=\"platoon rehearsal\">\
         <URL>can://{gateway}</URL>{buses}</CANBeacon>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beacon_names_the_address_and_every_bus() {
        let gateway = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 29536);
        let text = text(gateway, &["truck0".into(), "truck1".into()]);
        assert_eq!(
            text,
            "<CANBeacon name=\"platoon\" type=\"SocketCAN\" description=\"platoon rehearsal\">\
             <URL>can://127.0.0.1:29536</URL><Bus name=\"truck0\"/><Bus name=\"truck1\"/>\
             </CANBeacon>"
        );
        assert_eq!(audience(*gateway.ip()).ip(), &Ipv4Addr::new(127, 255, 255, 255));
    }
}
