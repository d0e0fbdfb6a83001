//! A bus that pretends to have a bit rate.
//!
//! ```text
//! rig --send--> | emulated wire: queue, arbitration, frame time | --> inner bus --> ECU
//! rig <-receive- |                                              | <-- inner bus <-- ECU
//! ```
//!
//! It sits at the rig's end of any bus. What the rig sends goes to the inner bus only when the wire
//! has carried it, and the rig hears it then as its own. What the ECU sends reaches the inner bus
//! at once, and the rig when the wire has carried it. Both compete for one wire, so that the rig
//! and its recording see the traffic in the order of a real bus.
//!
//! The wire's clock is bench time: it moves in [`Bus::set_bench_time`] and nowhere else. There the
//! ECU's frames are found, queued as of now, and there those that are through are delivered; so
//! frames are late by up to twice the time between two calls, never early. Outside of a run, before
//! [`Bus::begin`] and after [`Bus::end`], there is no bench time and frames pass at once.

use std::collections::VecDeque;

use super::{Backend, Bus, BusCounts, Queueing, ReceiveError, Received, SendError};
use crate::bus_time::{Arbiter, BusTiming, Request, Transfer, Urgency};
use crate::frame::Frame;
use core::time::Duration;

/// Frames that may wait for the wire: half a second of a full one.
const WAITING_MAX: usize = 1024;
/// Frames that may wait to be received.
const ARRIVED_MAX: usize = 4096;
/// Identifiers whose queueing is told; those of a foreign flood beyond are only carried.
const IDENTIFIERS: usize = 64;
/// The two nodes of the wire.
const RIG: u8 = 0;
const ECU: u8 = 1;

/// A bus at the rig's end whose frames take the time they would take on a real one.
#[derive(Debug)]
pub struct Emulated<B> {
    inner: B,
    timing: BusTiming,
    wire: Arbiter<Received>,
    arrived: VecDeque<Received>,
    queueing: Vec<Queueing>,
    is_running: bool,
    stamps_bench_time: bool,
    time_ns: u64,
    /// What the inner bus failed with while the wire was served; told by the next receive.
    failure: Option<ReceiveError>,
    counts: BusCounts,
}

impl<B: Bus> Emulated<B> {
    /// The rig's end of a bus, as it would be at these bit rates.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn new(inner: B, timing: BusTiming) -> Self {
        assert!(timing.nominal_hz > 0 && timing.data_hz > 0, "a bus has a bit rate");
        Self {
            inner,
            timing,
            wire: Arbiter::new(WAITING_MAX),
            arrived: VecDeque::with_capacity(ARRIVED_MAX),
            queueing: Vec::with_capacity(IDENTIFIERS),
            is_running: false,
            stamps_bench_time: false,
            time_ns: 0,
            failure: None,
            counts: BusCounts::default(),
        }
    }

    /// Stamps what is received with the bench time at which it was through, as fits a run in
    /// virtual time. Otherwise the inner bus's stamp is kept, moved by the time on the wire.
    #[must_use]
    pub fn stamping_bench_time(mut self) -> Self {
        self.stamps_bench_time = true;
        self
    }

    /// Takes everything from the inner bus to the wire.
    fn pull(&mut self) {
        loop {
            let received = match self.inner.receive() {
                Ok(Some(received)) => received,
                Ok(None) => return,
                Err(error) => {
                    self.failure = Some(error);
                    return;
                }
            };
            // The echo of what the wire has carried already, where the inner bus has one.
            if received.own {
                continue;
            }
            if received.frame.flags().is_error {
                self.deliver(received);
            } else if self.request(ECU, received).is_err() {
                self.counts.receive_overflow += 1;
            }
        }
    }

    fn request(&mut self, node: u8, cargo: Received) -> Result<(), SendError> {
        let request = Request {
            time_ns: self.time_ns,
            node,
            urgency: Urgency::of(&cargo.frame),
            duration_ns: self.timing.frame_time_ns(&cargo.frame),
            cargo,
        };
        self.wire.request(request).map_err(|_| SendError::BufferFull)
    }

    /// Delivers what the wire has carried by `time_ns`.
    fn carry(&mut self, time_ns: u64) {
        while let Some(transfer) = self.wire.advance(time_ns) {
            self.note(&transfer);
            let Transfer { request: Request { cargo, .. }, end_ns, .. } = transfer;
            let stamp_ns = match cargo.stamp_ns {
                _ if self.stamps_bench_time => end_ns,
                0 => 0,
                stamp_ns => stamp_ns + transfer.response_ns(),
            };
            if cargo.own {
                self.inner.set_bench_time(end_ns);
                // A refusal is counted there; on a real bus nobody would notice either.
                let _ = self.inner.send(&cargo.frame);
            }
            self.deliver(Received { stamp_ns, ..cargo });
        }
    }

    fn deliver(&mut self, received: Received) {
        if self.arrived.len() < ARRIVED_MAX {
            self.arrived.push_back(received);
        } else {
            self.counts.receive_overflow += u64::from(!received.own);
        }
    }

    fn note(&mut self, transfer: &Transfer<Received>) {
        let frame = &transfer.request.cargo.frame;
        let (id, is_extended) = (frame.id(), frame.flags().is_extended);
        let known = self.queueing.iter().position(|q| q.id == id && q.is_extended == is_extended);
        let index = known.unwrap_or(self.queueing.len());
        if index == self.queueing.len() && index < IDENTIFIERS {
            self.queueing.push(Queueing::new(id, is_extended));
        }
        if let Some(queueing) = self.queueing.get_mut(index) {
            queueing.note(transfer.response_ns());
        }
    }
}

impl<B: Bus> Bus for Emulated<B> {
    fn backend(&self) -> Backend {
        self.inner.backend()
    }

    fn name(&self) -> &str {
        self.inner.name()
    }

    fn echoes(&self) -> bool {
        true
    }

    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let echo = Received { frame: *frame, stamp_ns: 0, own: true };
        let sent = if frame.flags().is_error {
            Err(SendError::Unsupported)
        } else if self.is_running {
            self.request(RIG, echo)
        } else {
            self.inner.send(frame).map(|()| self.deliver(echo))
        };
        match sent {
            Ok(()) => self.counts.sent += 1,
            Err(SendError::BufferFull) => self.counts.send_full += 1,
            Err(_) => self.counts.send_failed += 1,
        }
        sent
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        let mut received = self.arrived.pop_front();
        if received.is_none() && !self.is_running {
            received = self.inner.receive()?;
            while received.is_some_and(|received| received.own) {
                received = self.inner.receive()?;
            }
        }
        if let Some(received) = received.filter(|received| !received.frame.flags().is_error) {
            self.counts.received += u64::from(!received.own);
            self.counts.own_echo += u64::from(received.own);
        }
        Ok(received)
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        if self.arrived.is_empty() { self.inner.wait(timeout) } else { Ok(true) }
    }

    fn counts(&self) -> BusCounts {
        let inner = self.inner.counts();
        let own = self.counts;
        BusCounts {
            send_full: own.send_full + inner.send_full,
            send_failed: own.send_failed + inner.send_failed,
            receive_overflow: own.receive_overflow + inner.receive_overflow,
            sent: own.sent,
            received: own.received,
            own_echo: own.own_echo,
            ..inner
        }
    }

    fn set_bench_time(&mut self, time_ns: u64) {
        if !self.is_running {
            self.inner.set_bench_time(time_ns);
            return;
        }
        self.time_ns = self.time_ns.max(time_ns);
        self.pull();
        self.carry(self.time_ns);
    }

    fn begin(&mut self) {
        self.inner.begin();
        self.wire.restart();
        self.queueing.clear();
        (self.is_running, self.time_ns) = (true, 0);
    }

    fn end(&mut self) {
        if self.is_running {
            self.pull();
            self.carry(u64::MAX);
        }
        self.is_running = false;
        self.inner.end();
    }

    fn queueing(&self) -> &[Queueing] {
        &self.queueing
    }
}
