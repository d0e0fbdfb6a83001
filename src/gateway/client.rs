//! One client of the gateway: a node on one truck's bus.

use std::future::pending;
use std::io;
use std::time::Duration;

use platoon_dbc::{Bus, Frame};
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep_until};

use super::protocol::{Command, Splitter, write_frame};
use super::{Buses, Counts};

/// Bytes a client may leave unread here before it is dropped: some seconds of a busy bus.
pub(super) const UNREAD_MAX: usize = 512 << 10;
/// Frames taken from the bus in one go.
const BATCH_MAX: usize = 256;
/// Time between two looks at the bus: a busy one shall not wake us for every frame, and nobody
/// who watches a bus through TCP notices.
const REST: Duration = Duration::from_millis(5);
/// Silence after the answer to `rawmode`: python-can and SavvyCAN take a first read that holds
/// more than the answer for an error.
const SILENCE_AFTER_OK: Duration = Duration::from_millis(100);
/// Time a frame of a client takes, however fast it sends: about that of 64 bytes at 500k/2M bit/s.
const SEND_TIME: Duration = Duration::from_micros(400);
/// Bytes read from the client at a time.
const READ_BYTES: usize = 4096;

/// Why a connection ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// The client left, or its connection broke.
    Gone,
    /// It asked for a bus that it cannot have.
    NoBus,
    /// It did not read what it asked for.
    TooSlow,
    /// The bus failed.
    BusFailed,
}

/// A connection.
pub(super) struct Client<'a> {
    stream: TcpStream,
    buses: &'a Buses,
    counts: &'a Counts,
    bus: Option<Box<dyn Bus>>,
    /// When to look at the bus next; none outside of raw mode.
    look: Option<Instant>,
    /// When to listen to the client again.
    listen: Instant,
    unsent: Vec<u8>,
    overflow_seen: u64,
}

impl<'a> Client<'a> {
    pub(super) fn new(stream: TcpStream, buses: &'a Buses, counts: &'a Counts) -> Self {
        let unsent = b"< hi >".to_vec();
        let listen = Instant::now();
        Self { stream, buses, counts, bus: None, look: None, listen, unsent, overflow_seen: 0 }
    }

    /// Serves the client until one side ends it.
    pub(super) async fn serve(mut self) -> End {
        let mut splitter = Splitter::default();
        let mut bytes = [0; READ_BYTES];
        let end = loop {
            let step = tokio::select! {
                read = receive(&self.stream, &mut bytes, self.listen) => match read {
                    Ok(count @ 1..) => self.obey(&mut splitter, &bytes[..count]),
                    Ok(0) | Err(_) => Err(End::Gone),
                },
                written = flush(&self.stream, &self.unsent) => match written {
                    Ok(count) => {
                        self.unsent.drain(..count);
                        Ok(())
                    }
                    Err(_) => Err(End::Gone),
                },
                () = until(self.look) => self.pass_on(),
            };
            if let Err(end) = step {
                break end;
            }
            if self.unsent.len() > UNREAD_MAX {
                break End::TooSlow;
            }
        };
        // The last words, as far as they can be said at once.
        let _ = self.stream.try_write(&self.unsent);
        end
    }

    /// Does what the elements in these bytes ask for.
    fn obey(&mut self, splitter: &mut Splitter, bytes: &[u8]) -> Result<(), End> {
        let mut outcome = Ok(());
        splitter.feed(bytes, |element| {
            if outcome.is_ok() {
                outcome = match element.and_then(Command::parse) {
                    Ok(command) => self.command(command),
                    Err(malformed) => {
                        self.counts.malformed.add(1);
                        self.refuse(malformed.words());
                        Ok(())
                    }
                };
            }
        });
        outcome
    }

    fn command(&mut self, command: Command<'_>) -> Result<(), End> {
        match (command, &self.bus) {
            (Command::Echo, _) => self.answer("echo"),
            (Command::Open(name), None) => return self.open(name),
            (Command::RawMode, Some(_)) => {
                self.forget_what_waits();
                self.look = Some(Instant::now() + SILENCE_AFTER_OK);
                self.answer("ok");
            }
            (Command::BcmMode, Some(_)) => {
                self.look = None;
                self.answer("ok");
            }
            (Command::Send(frame), Some(_)) => self.send(&frame),
            (Command::Open(_), Some(_)) => self.refuse("a bus is open already"),
            (_, None) => self.refuse("open a bus first"),
        }
        Ok(())
    }

    fn open(&mut self, name: &str) -> Result<(), End> {
        match self.buses.open(name) {
            Ok(bus) => {
                self.bus = Some(bus);
                self.answer("ok");
                Ok(())
            }
            Err(reason) => {
                self.refuse(format_args!("could not open bus: {reason}"));
                Err(End::NoBus)
            }
        }
    }

    fn send(&mut self, frame: &Frame) {
        let Some(bus) = &mut self.bus else { return };
        self.listen = self.listen.max(Instant::now()) + SEND_TIME;
        match bus.send(frame) {
            Ok(()) => self.counts.from_clients.add(1),
            Err(error) => {
                self.counts.not_sent.add(1);
                self.refuse(format_args!("not sent: {error}"));
            }
        }
    }

    /// Raw mode begins with what comes after it was asked for.
    fn forget_what_waits(&mut self) {
        let Some(bus) = &mut self.bus else { return };
        while let Ok(Some(_)) = bus.receive() {}
    }

    /// Writes down what waits on the bus, in one go.
    fn pass_on(&mut self) -> Result<(), End> {
        let Some(bus) = &mut self.bus else { return Ok(()) };
        let mut count = 0;
        while count < BATCH_MAX {
            match bus.receive() {
                Ok(Some(received)) => write_frame(&mut self.unsent, &received),
                Ok(None) => break,
                Err(_) => return Err(End::BusFailed),
            }
            count += 1;
        }
        let overflow = bus.counts().receive_overflow;
        self.counts.to_clients.add(count as u64);
        self.counts.overflow.add(overflow - self.overflow_seen);
        self.overflow_seen = overflow;
        let rest = if count == BATCH_MAX { Duration::ZERO } else { REST };
        self.look = Some(Instant::now() + rest);
        Ok(())
    }

    fn answer(&mut self, words: impl std::fmt::Display) {
        self.unsent.extend_from_slice(format!("< {words} >").as_bytes());
    }

    fn refuse(&mut self, reason: impl std::fmt::Display) {
        self.answer(format_args!("error {reason}"));
    }
}

/// Reads what the client sent, when it is time to.
async fn receive(stream: &TcpStream, bytes: &mut [u8], listen: Instant) -> io::Result<usize> {
    sleep_until(listen).await;
    loop {
        stream.readable().await?;
        match stream.try_read(bytes) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            read => return read,
        }
    }
}

/// Writes some of what waits for the client; never ends while nothing does.
async fn flush(stream: &TcpStream, unsent: &[u8]) -> io::Result<usize> {
    if unsent.is_empty() {
        return pending().await;
    }
    loop {
        stream.writable().await?;
        match stream.try_write(unsent) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            written => return written,
        }
    }
}

/// Waits until it is time to look at the bus; for ever where nobody wants to.
async fn until(look: Option<Instant>) {
    match look {
        Some(look) => sleep_until(look).await,
        None => pending().await,
    }
}
