//! The socketcand gateway: python-can, SavvyCAN and their like attach to a run over TCP.
//!
//! Every connection is one more node on the bus it opens, so the rig and the ECUs see what it sends
//! as traffic of a stranger, and nothing else changes. The gateway is a thread of its own, less
//! urgent than any other, with a bound on everything: a client that does not read is dropped.

mod beacon;
mod client;
mod protocol;
#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::fmt;
use std::io;
use std::rc::Rc;

use platoon_dbc::Bus;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpListener;

use crate::bus::BusAddress;
use crate::cli::GatewayPlace;
use crate::failure::Failure;
use crate::service::Service;
use client::{Client, End};

/// Most clients at a time.
const CLIENTS_MAX: u64 = 64;
/// Room in the kernel for what a client has not read yet \[bytes\].
const SEND_BUFFER_BYTES: usize = 128 << 10;

/// The buses clients may open.
#[derive(Debug)]
pub struct Buses {
    address: BusAddress,
    /// Trucks on a bus that others can join.
    trucks: Vec<u8>,
}

impl Buses {
    /// The buses of these trucks, called `truck0` and so on.
    pub const fn new(address: BusAddress, trucks: Vec<u8>) -> Self {
        Self { address, trucks }
    }

    fn names(&self) -> Vec<String> {
        self.trucks.iter().map(|truck| format!("truck{truck}")).collect()
    }

    fn open(&self, name: &str) -> Result<Box<dyn Bus>, String> {
        let truck = self.trucks.iter().find(|truck| format!("truck{truck}") == name);
        let truck = truck.ok_or_else(|| format!("there is {}", self.names().join(", ")))?;
        self.address.open(*truck).map_err(|failure| failure.to_string())
    }
}

/// A number that several clients count on, all in the gateway's thread.
#[derive(Debug, Default)]
struct Count(Cell<u64>);

impl Count {
    fn add(&self, more: u64) {
        self.0.set(self.0.get() + more);
    }
    fn get(&self) -> u64 {
        self.0.get()
    }
}

/// What happened at the gateway so far.
#[derive(Debug, Default)]
struct Counts {
    clients: Count,
    left: Count,
    refused: Count,
    too_slow: Count,
    to_clients: Count,
    from_clients: Count,
    not_sent: Count,
    overflow: Count,
    malformed: Count,
}

/// What happened at the gateway during a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GatewayReport {
    /// Connections served.
    pub clients: u64,
    /// Connections refused because there were too many.
    pub refused: u64,
    /// Clients dropped because they did not read.
    pub too_slow: u64,
    /// Frames passed on to clients.
    pub to_clients: u64,
    /// Frames that clients put on a bus.
    pub from_clients: u64,
    /// Frames of clients that a bus did not take.
    pub not_sent: u64,
    /// Frames that a client missed because the gateway did not get to read its bus.
    pub overflow: u64,
    /// What clients said that is no command.
    pub malformed: u64,
}

impl fmt::Display for GatewayReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { clients, to_clients, from_clients, .. } = self;
        write!(
            f,
            "socketcand: {clients} clients, {to_clients} frames to them, {from_clients} from them"
        )?;
        for (number, what) in [
            (self.not_sent, "frames the bus did not take"),
            (self.overflow, "frames missed"),
            (self.malformed, "malformed commands"),
            (self.too_slow, "clients dropped for not reading"),
            (self.refused, "clients too many"),
        ] {
            if number > 0 {
                write!(f, ", {number} {what}")?;
            }
        }
        Ok(())
    }
}

/// A gateway at work.
pub type Gateway = Service<GatewayReport>;

impl Gateway {
    /// Opens the port and serves from now on.
    ///
    /// # Errors
    /// When the port cannot be had.
    pub fn start(place: GatewayPlace, buses: Buses) -> Result<Self, Failure> {
        let failed = |error: io::Error| {
            let remedy = match error.kind() {
                io::ErrorKind::AddrInUse => {
                    "another program has this port; choose another, or 0 for any that is free"
                }
                io::ErrorKind::PermissionDenied => "choose a port from 1024 on",
                io::ErrorKind::AddrNotAvailable => "give an address of this machine",
                _ => "choose another address or port",
            };
            Failure::cannot_start(format!("--socketcand {}: {error}; {remedy}", place.address))
        };
        let has_beacon = place.has_beacon;
        let prepare = move || (Rc::new(buses), Rc::new(Counts::default()));
        let serve = async move |listener: TcpListener, (buses, counts): &State| {
            let (address, names) = (listener.local_addr()?, buses.names());
            let beacon = async {
                if has_beacon {
                    beacon::send(address, &names).await;
                }
                std::future::pending::<io::Result<()>>().await
            };
            tokio::select! {
                ended = accept(listener, buses, counts) => ended,
                ended = beacon => ended,
            }
        };
        Self::listen("socketcand", place.address, prepare, serve, |(_, counts)| counts.report())
            .map_err(failed)
    }
}

/// What the clients of a gateway share.
type State = (Rc<Buses>, Rc<Counts>);

/// Serves whoever comes.
async fn accept(listener: TcpListener, buses: &Rc<Buses>, counts: &Rc<Counts>) -> io::Result<()> {
    loop {
        let Ok((mut stream, _)) = listener.accept().await else {
            // Out of descriptors, or the client is gone already: try again a little later.
            tokio::time::sleep(std::time::Duration::from_millis(100)).await;
            continue;
        };
        if counts.clients.get() - counts.left.get() >= CLIENTS_MAX {
            counts.refused.add(1);
            let _ = stream.write_all(b"< error too many clients >").await;
            continue;
        }
        // What a client does not read must not pile up in the kernel either.
        let _ = rustix::net::sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER_BYTES);
        // Small answers must not wait for more; where that is refused they do.
        let _ = stream.set_nodelay(true);
        let (buses, counts) = (Rc::clone(buses), Rc::clone(counts));
        counts.clients.add(1);
        tokio::task::spawn_local(async move {
            let end = Client::new(stream, &buses, &counts).serve().await;
            counts.left.add(1);
            counts.too_slow.add(u64::from(end == End::TooSlow));
        });
    }
}

impl Counts {
    fn report(&self) -> GatewayReport {
        GatewayReport {
            clients: self.clients.get(),
            refused: self.refused.get(),
            too_slow: self.too_slow.get(),
            to_clients: self.to_clients.get(),
            from_clients: self.from_clients.get(),
            not_sent: self.not_sent.get(),
            overflow: self.overflow.get(),
            malformed: self.malformed.get(),
        }
    }
}
