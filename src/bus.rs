//! Which bus a run uses, and opening one's end of it.

use platoon_dbc::{Bus, OpenError, PortLease, SocketCan, Udp, UdpOptions};
use vcan_setup::can::{self, Vcan};

use crate::cli::{BusKind, BusPlace};
use crate::failure::Failure;

/// How long an interface is watched for foreign traffic before it is used \[ms\].
const LISTEN_MS: u64 = 250;

/// The bus of one run: where every truck's bus is.
#[derive(Debug)]
pub struct BusChoice {
    address: BusAddress,
    /// Keeps the UDP port for the run; none in a process that joins another's.
    _lease: Option<PortLease>,
    /// Why this one, for people.
    pub reason: String,
    /// Whether commands on a physical interface were allowed.
    armed: bool,
    /// Interfaces made for this run, to be removed at its end.
    made: Vec<Vcan>,
}

/// Where the buses of a run are: enough to open one more end of each.
#[derive(Debug, Clone)]
pub enum BusAddress {
    /// Interfaces of the kernel, one per truck.
    SocketCan {
        /// Their names; none for truck0, truck1 and so on.
        interfaces: Vec<String>,
    },
    /// Multicast groups on the loopback interface.
    Udp {
        /// The port they share.
        port: u16,
    },
    /// In memory.
    Loopback,
}

impl BusChoice {
    /// Chooses the bus of a run of `trucks` trucks, creating interfaces where that is allowed.
    ///
    /// # Errors
    /// When the bus asked for is not to be had; `auto` falls back to udp instead.
    pub fn for_run(asked: BusKind, place: &BusPlace, trucks: usize) -> Result<Self, Failure> {
        match asked {
            BusKind::Loopback => Ok(Self::loopback()),
            BusKind::Udp => Self::udp(place, "asked for".into()),
            BusKind::Socketcan => Self::socketcan(place, trucks, "asked for".into()),
            BusKind::Auto if !place.interfaces.is_empty() => {
                Self::socketcan(place, trucks, "interfaces were named".into())
            }
            BusKind::Auto if place.port.is_some() => {
                Self::udp(place, "a UDP port was named".into())
            }
            BusKind::Auto if !can::kernel_support().is_available() => {
                Self::udp(place, "this kernel has no CAN".into())
            }
            BusKind::Auto => {
                Self::socketcan(place, trucks, "the kernel has CAN".into()).or_else(|why_not| {
                    Self::udp(place, format!("kernel CAN is not to be had: {why_not}"))
                })
            }
        }
    }

    /// The bus of a process that joins a run: interfaces or port as that run announced them.
    ///
    /// # Errors
    /// When the place does not say where the bus is.
    pub fn joining(asked: BusKind, place: &BusPlace) -> Result<Self, Failure> {
        let udp = matches!(asked, BusKind::Udp)
            || (asked == BusKind::Auto
                && place.interfaces.is_empty()
                && !can::kernel_support().is_available());
        let address = match asked {
            BusKind::Loopback => {
                return Err(Failure::usage(
                    "--bus loopback lives inside one process; \
                     use `platoon rehearse --virtual-time`",
                ));
            }
            _ if udp => BusAddress::Udp { port: place.port.unwrap_or(Udp::FIRST_PORT) },
            _ => BusAddress::SocketCan { interfaces: place.interfaces.clone() },
        };
        let mut joined = Self::at(address, "joining a run");
        joined.armed = place.arm;
        joined.armed_if_physical()
    }

    /// In memory, for virtual time.
    pub fn loopback() -> Self {
        Self::at(BusAddress::Loopback, "virtual time")
    }

    fn at(address: BusAddress, reason: impl Into<String>) -> Self {
        Self { address, _lease: None, reason: reason.into(), armed: false, made: Vec::new() }
    }

    fn udp(place: &BusPlace, reason: String) -> Result<Self, Failure> {
        let lease = PortLease::acquire(place.port.unwrap_or(Udp::FIRST_PORT))
            .map_err(Failure::cannot_start)?;
        let port = lease.port();
        match place.port {
            Some(asked) if asked != port => Err(Failure::cannot_start(format!(
                "--port {asked}: another run or program has it; choose another, or leave --port \
                 out to take the next free one (now {port})"
            ))),
            _ => {
                let mut chosen = Self::at(BusAddress::Udp { port }, reason);
                chosen._lease = Some(lease);
                Ok(chosen)
            }
        }
    }

    fn socketcan(place: &BusPlace, trucks: usize, reason: String) -> Result<Self, Failure> {
        let (interfaces, made) = if place.interfaces.is_empty() {
            let names: Vec<String> = (0..trucks).map(|i| format!("truck{i}")).collect();
            let words: Vec<&str> = names.iter().map(String::as_str).collect();
            let made = can::ensure_vcan(&words).map_err(Failure::cannot_start)?.created;
            (names, made)
        } else {
            (named_interfaces(place, trucks)?, Vec::new())
        };
        let address = BusAddress::SocketCan { interfaces };
        let mut chosen = Self::at(address, reason);
        (chosen.armed, chosen.made) = (place.arm, made);
        let chosen = chosen.armed_if_physical()?;
        if place.share { Ok(chosen) } else { chosen.alone() }
    }

    /// Refuses physical interfaces that are not armed.
    fn armed_if_physical(self) -> Result<Self, Failure> {
        for name in self.socketcan_interfaces() {
            if !self.armed && can::may_be_physical(name) {
                return Err(Failure::usage(format!(
                    "--interfaces {name}: not a virtual CAN interface (vcan, vxcan), real \
                     actuators may move; say --arm if that is meant"
                )));
            }
        }
        Ok(self)
    }

    /// Refuses interfaces that others use already.
    fn alone(self) -> Result<Self, Failure> {
        for name in self.socketcan_interfaces() {
            if carries_traffic(name)? {
                return Err(Failure::cannot_start(format!(
                    "interface {name}: carries traffic already; choose another interface, or say \
                     --share to join it"
                )));
            }
        }
        Ok(self)
    }

    fn socketcan_interfaces(&self) -> impl Iterator<Item = &String> {
        match &self.address {
            BusAddress::SocketCan { interfaces } => interfaces.iter(),
            BusAddress::Udp { .. } | BusAddress::Loopback => [].iter(),
        }
    }

    /// Kind of the bus, in the words of the summary.
    pub fn backend(&self) -> &'static str {
        match self.address {
            BusAddress::SocketCan { .. } => "socketcan",
            BusAddress::Udp { .. } => "udp",
            BusAddress::Loopback => "loopback",
        }
    }

    /// Name of each truck's bus.
    pub fn interfaces(&self, trucks: usize) -> Vec<String> {
        (0..trucks)
            .map(|truck| match &self.address {
                BusAddress::SocketCan { interfaces } => {
                    interfaces.get(truck).cloned().unwrap_or_default()
                }
                BusAddress::Udp { port, .. } => {
                    format!("udp:{}:{port}", Udp::group_of_bus(truck as u8))
                }
                BusAddress::Loopback => format!("loopback{truck}"),
            })
            .collect()
    }

    /// The options that make another process join this bus.
    pub fn as_arguments(&self) -> Vec<String> {
        let words: Vec<String> = match &self.address {
            BusAddress::SocketCan { interfaces } => {
                let arm = self.armed.then(|| "--arm".to_owned());
                let place = ["--interfaces".to_owned(), interfaces.join(",")];
                place.into_iter().chain(arm).collect()
            }
            BusAddress::Udp { port, .. } => vec!["--port".into(), port.to_string()],
            BusAddress::Loopback => Vec::new(),
        };
        ["--bus".to_owned(), self.backend().to_owned()].into_iter().chain(words).collect()
    }

    /// Opens one end of a truck's bus.
    ///
    /// # Errors
    /// What the back-end says, with the remedy.
    pub fn open(&self, truck: u8) -> Result<Box<dyn Bus>, Failure> {
        self.address.open(truck)
    }

    /// Opens the rig's end of a truck's bus, which hears its own frames too: it records the bus.
    ///
    /// # Errors
    /// What the back-end says, with the remedy.
    pub fn open_for_rig(&self, truck: u8) -> Result<Box<dyn Bus>, Failure> {
        self.address.open_end(truck, true)
    }

    /// Where the buses are, for those who open ends of them elsewhere.
    pub fn address(&self) -> &BusAddress {
        &self.address
    }
}

impl BusAddress {
    /// Opens one end of a truck's bus.
    ///
    /// # Errors
    /// What the back-end says, with the remedy.
    pub fn open(&self, truck: u8) -> Result<Box<dyn Bus>, Failure> {
        self.open_end(truck, false)
    }

    fn open_end(&self, truck: u8, echoes: bool) -> Result<Box<dyn Bus>, Failure> {
        let opened: Result<Box<dyn Bus>, OpenError> = match self {
            BusAddress::SocketCan { interfaces } => {
                // A single interface given to a lone ECU is that truck's, whatever its number.
                let name = match interfaces.as_slice() {
                    [] => format!("truck{truck}"),
                    [only] => only.clone(),
                    many => many.get(usize::from(truck)).cloned().ok_or_else(|| {
                        Failure::usage(format!(
                            "--interfaces names {} interfaces, none for truck {truck}",
                            many.len()
                        ))
                    })?,
                };
                let bus = SocketCan::open(&name);
                let bus = if echoes { bus.and_then(SocketCan::with_echo) } else { bus };
                bus.map(|bus| Box::new(bus) as _)
            }
            BusAddress::Udp { port, .. } => {
                let tag = format!("truck{truck}");
                let group = Udp::group_of_bus(truck);
                Udp::join(UdpOptions { group, port: *port, tag: &tag })
                    .map(|bus| Box::new(if echoes { bus.with_echo() } else { bus }) as _)
            }
            BusAddress::Loopback => {
                return Err(Failure::usage("the loopback bus has no end outside its process"));
            }
        };
        opened.map_err(Failure::cannot_start)
    }
}

impl Drop for BusChoice {
    fn drop(&mut self) {
        // Interfaces we made; one that somebody else removed meanwhile is no loss.
        let _ = can::remove_vcan(&self.made);
    }
}

fn named_interfaces(place: &BusPlace, trucks: usize) -> Result<Vec<String>, Failure> {
    if place.interfaces.len() < trucks {
        return Err(Failure::usage(format!(
            "--interfaces names {} of them, the scenario has {trucks} trucks; name one per truck",
            place.interfaces.len()
        )));
    }
    Ok(place.interfaces[..trucks].to_vec())
}

/// Listens for a moment, to keep out of somebody else's bus.
fn carries_traffic(name: &str) -> Result<bool, Failure> {
    let mut bus = SocketCan::open(name).map_err(Failure::cannot_start)?;
    bus.wait(std::time::Duration::from_millis(LISTEN_MS))
        .map_err(|error| Failure::cannot_start(format!("interface {name}: {error}")))
}
