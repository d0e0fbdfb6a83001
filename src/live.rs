//! `--live`: the run, while it lasts, for Foxglove and Lichtblick over a WebSocket on loopback.
//!
//! A thread of the supervisor, less urgent than any other, follows the files that rig and ECUs
//! record into and passes on what guests subscribed to, as the merged trace will hold it. The loops
//! do not know of it: they record either way. What a guest does not read in time is dropped for
//! that guest and counted.

mod feed;
mod guest;
mod words;

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::net::Ipv4Addr;
use std::rc::Rc;
use std::time::Duration;
use std::{fmt, io};

use tokio::net::TcpListener;
use tokio_tungstenite::tungstenite::Message as Parcel;
use traces::Offer;

use crate::failure::Failure;
use crate::service::Service;
use guest::Guest;

pub use feed::Feed;

/// Port that Foxglove and Lichtblick look at by default.
pub const PORT_DEFAULT: &str = "8765";
/// Time between two looks at the files: recorders close a chunk every 100 ms.
const PERIOD: Duration = Duration::from_millis(50);
/// Most guests at a time.
const GUESTS_MAX: usize = 8;

/// What was passed on during a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LiveReport {
    guests: u64,
    sent: u64,
    dropped: u64,
}

impl fmt::Display for LiveReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { guests, sent, dropped } = self;
        write!(f, "live view: {guests} guests, {sent} messages to them")?;
        if *dropped > 0 {
            write!(f, ", {dropped} dropped because they did not read")?;
        }
        Ok(())
    }
}

/// Everyone who looks, and what there is to see.
#[derive(Default)]
struct Hall {
    /// What the run is called.
    title: String,
    /// Channels by number, from 1 on.
    offers: RefCell<Vec<Offer>>,
    numbers: RefCell<BTreeMap<String, u32>>,
    guests: RefCell<Vec<Rc<Guest>>>,
    came: Cell<u64>,
    sent: Cell<u64>,
    dropped: Cell<u64>,
}

impl Hall {
    /// The number of a channel; a new one is announced to all.
    fn number(&self, topic: &str, offer: impl FnOnce() -> Offer) -> u32 {
        if let Some(number) = self.numbers.borrow().get(topic) {
            return *number;
        }
        self.offers.borrow_mut().push(offer());
        let offers = self.offers.borrow();
        let number = offers.len() as u32;
        self.numbers.borrow_mut().insert(topic.to_owned(), number);
        let news = words::advertise(&offers[offers.len() - 1..], number);
        for guest in self.guests.borrow().iter() {
            self.count(guest.offer(Parcel::text(news.clone())));
        }
        number
    }

    /// Passes a message on to who subscribed to its channel.
    fn publish(&self, number: u32, log_time_ns: u64, data: &[u8]) {
        for guest in self.guests.borrow().iter() {
            if let Some(subscription) = guest.subscription(number) {
                let parcel = words::message_data(subscription, log_time_ns, data);
                self.count(guest.offer(Parcel::binary(parcel)));
            }
        }
    }

    fn count(&self, was_taken: bool) {
        let counter = if was_taken { &self.sent } else { &self.dropped };
        counter.set(counter.get() + 1);
    }

    fn report(&self) -> LiveReport {
        LiveReport { guests: self.came.get(), sent: self.sent.get(), dropped: self.dropped.get() }
    }
}

/// A live view being served.
pub type Live = Service<LiveReport>;

impl Live {
    /// Opens the port on loopback and serves from now on.
    ///
    /// # Errors
    /// When the port cannot be had.
    pub fn start(port: u16, title: String, feed: Feed) -> Result<Self, Failure> {
        let prepare = move || Rc::new(Hall { title, ..Hall::default() });
        let serve = async move |listener: TcpListener, hall: &Rc<Hall>| {
            tokio::select! {
                ended = accept(listener, hall) => ended,
                () = pass_on(feed, hall) => Ok(()),
            }
        };
        let address = (Ipv4Addr::LOCALHOST, port).into();
        Self::listen("live", address, prepare, serve, |hall| hall.report()).map_err(|error| {
            Failure::cannot_start(format!(
                "--live={port}: {error}; choose another port, or 0 for any that is free"
            ))
        })
    }
}

/// Lets guests in.
async fn accept(listener: TcpListener, hall: &Rc<Hall>) -> io::Result<()> {
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Out of descriptors, or the guest is gone already: try again a little later.
            tokio::time::sleep(PERIOD).await;
            continue;
        };
        if hall.guests.borrow().len() < GUESTS_MAX {
            let hall = Rc::clone(hall);
            tokio::task::spawn_local(async move { guest::serve(stream, &hall).await });
        }
    }
}

/// Follows the recordings for as long as somebody looks.
async fn pass_on(mut feed: Feed, hall: &Hall) {
    let mut was_watched = false;
    loop {
        tokio::time::sleep(PERIOD).await;
        let is_watched = !hall.guests.borrow().is_empty();
        if is_watched && !was_watched {
            // Whoever comes late sees what happens from now on.
            feed.read(|_, _, _| ());
        } else if is_watched {
            feed.read(|source, time_ns, data| {
                let number = hall.number(&source.topic(), || source.offer());
                hall.publish(number, time_ns, data);
            });
        }
        was_watched = is_watched;
    }
}
