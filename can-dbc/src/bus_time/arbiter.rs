//! A bus played frame by frame: the most urgent frame waiting goes first and is never interrupted.

use crate::frame::Frame;

/// Place in the order of arbitration: of two frames that start at once, the smaller one wins.
///
/// The arbitration field as it is sent, a dominant bit being 0: eleven bits of identifier, then
/// RTR (or SRR), IDE, eighteen more bits of identifier and RTR. So a base frame beats an extended
/// one whose identifier begins with the same eleven bits, and a data frame beats a remote request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Urgency(u32);

impl Urgency {
    /// That of a frame.
    pub const fn of(frame: &Frame) -> Self {
        let flags = frame.flags();
        Self::of_field(frame.id(), flags.is_extended, flags.is_rtr)
    }

    /// That of every data frame with this identifier.
    pub const fn of_id(id: u32, is_extended: bool) -> Self {
        Self::of_field(id, is_extended, false)
    }

    const fn of_field(id: u32, is_extended: bool, is_rtr: bool) -> Self {
        let request = is_rtr as u32;
        if is_extended {
            let (base, rest) = (id >> 18, id & 0x3_FFFF);
            Self(base << 21 | 0b11 << 19 | rest << 1 | request)
        } else {
            Self(id << 21 | request << 20)
        }
    }
}

/// A frame that some node wants to send, with whatever its sender needs to know it by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request<C> {
    /// When its sender queues it \[ns\].
    pub time_ns: u64,
    /// Number of the node. Decides between equal urgencies, which a real bus forbids.
    pub node: u8,
    /// Its place in arbitration.
    pub urgency: Urgency,
    /// How long it holds the bus, intermission included \[ns\].
    pub duration_ns: u64,
    /// What it is to its sender.
    pub cargo: C,
}

/// A frame that has crossed the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer<C> {
    /// What was asked for, with the time at which the bus learnt of it.
    pub request: Request<C>,
    /// When it won arbitration \[ns\].
    pub start_ns: u64,
    /// When the bus was free again, three bits after the frame itself \[ns\].
    pub end_ns: u64,
}

impl<C> Transfer<C> {
    /// From queueing to the free bus \[ns\].
    pub const fn response_ns(&self) -> u64 {
        self.end_ns - self.request.time_ns
    }
}

/// No room for another frame; it has been counted and is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the queue of the bus is full")]
pub struct QueueFull;

/// One bus and the frames waiting for it.
///
/// Requests and looks come in order of time; a request for a time already looked at counts from
/// there. Equal requests give equal transfers, whatever the times of the looks in between. Nothing
/// is allocated after construction.
#[derive(Clone, Debug)]
pub struct Arbiter<C> {
    waiting: Vec<Waiting<C>>,
    capacity: usize,
    under_way: Option<Transfer<C>>,
    /// Everything before this time is decided \[ns\].
    decided_ns: u64,
    free_ns: u64,
    requests: u64,
    overflowed: u64,
}

#[derive(Clone, Copy, Debug)]
struct Waiting<C> {
    request: Request<C>,
    /// Number of the request: what one node queues with equal urgency keeps its order.
    number: u64,
}

impl<C: Copy> Arbiter<C> {
    /// A free bus at time 0, with room for `capacity` frames waiting.
    pub fn new(capacity: usize) -> Self {
        Self {
            waiting: Vec::with_capacity(capacity),
            capacity,
            under_way: None,
            decided_ns: 0,
            free_ns: 0,
            requests: 0,
            overflowed: 0,
        }
    }

    /// A free bus at time 0 again; what was waiting is gone.
    pub fn restart(&mut self) {
        self.waiting.clear();
        self.under_way = None;
        (self.decided_ns, self.free_ns) = (0, 0);
    }

    /// Queues a frame.
    ///
    /// # Errors
    /// [`QueueFull`], and the frame is lost.
    pub fn request(&mut self, request: Request<C>) -> Result<(), QueueFull> {
        if self.waiting.len() == self.capacity {
            self.overflowed += 1;
            return Err(QueueFull);
        }
        let request = Request { time_ns: request.time_ns.max(self.decided_ns), ..request };
        self.waiting.push(Waiting { request, number: self.requests });
        self.requests += 1;
        Ok(())
    }

    /// The next frame that has crossed the bus by `to_ns`; to be called until there is none.
    ///
    /// A frame that could start at `to_ns` itself is not decided yet: one more urgent may still
    /// be queued for that very instant.
    pub fn advance(&mut self, to_ns: u64) -> Option<Transfer<C>> {
        self.decided_ns = self.decided_ns.max(to_ns);
        let transfer = match self.under_way.take() {
            Some(transfer) => transfer,
            None => self.start(to_ns)?,
        };
        if transfer.end_ns > to_ns {
            self.under_way = Some(transfer);
            return None;
        }
        Some(transfer)
    }

    /// Frames waiting or on the bus.
    pub fn pending(&self) -> usize {
        self.waiting.len() + usize::from(self.under_way.is_some())
    }

    /// Requests refused because the queue was full.
    pub const fn overflowed(&self) -> u64 {
        self.overflowed
    }

    /// Puts the winner of the next arbitration before `to_ns` on the bus.
    fn start(&mut self, to_ns: u64) -> Option<Transfer<C>> {
        let earliest_ns = self.waiting.iter().map(|waiting| waiting.request.time_ns).min()?;
        let start_ns = earliest_ns.max(self.free_ns);
        if start_ns >= to_ns {
            return None;
        }
        let ready = self.waiting.iter().enumerate().filter(|(_, w)| w.request.time_ns <= start_ns);
        let (winner, _) =
            ready.min_by_key(|(_, w)| (w.request.urgency, w.request.node, w.number))?;
        let request = self.waiting.swap_remove(winner).request;
        self.free_ns = start_ns + request.duration_ns;
        Some(Transfer { request, start_ns, end_ns: self.free_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameFlags;

    fn request(time_ns: u64, id: u32, cargo: u32) -> Request<u32> {
        let urgency = Urgency::of_id(id, true);
        Request { time_ns, node: 0, urgency, duration_ns: 100, cargo }
    }

    fn carried(arbiter: &mut Arbiter<u32>, to_ns: u64) -> Vec<(u32, u64, u64)> {
        std::iter::from_fn(|| arbiter.advance(to_ns))
            .map(|done| (done.request.cargo, done.start_ns, done.end_ns))
            .collect()
    }

    #[test]
    fn urgency_is_the_order_of_the_arbitration_field() {
        let flags = FrameFlags::default();
        let base = |id| Urgency::of(&Frame::new(id, flags, &[]).expect("valid"));
        let extended = |id| Urgency::of_id(id, true);
        let in_order = [
            extended(0),
            extended(0x3_FFFF),
            base(1),
            Urgency::of(&Frame::remote(1, false, 0).expect("valid")),
            extended(1 << 18),
            Urgency::of(&Frame::remote(1 << 18, true, 0).expect("valid")),
            extended((1 << 18) + 1),
            base(2),
            base(0x7FF),
            extended(0x1FFF_FFFF),
        ];
        assert!(in_order.is_sorted_by(|a, b| a < b), "{in_order:?}");
    }

    #[test]
    fn the_most_urgent_goes_first_and_is_never_interrupted() {
        let mut arbiter = Arbiter::new(8);
        for asked in [request(0, 9, 9), request(10, 5, 5), request(20, 3, 3), request(150, 1, 1)] {
            arbiter.request(asked).expect("room");
        }
        let expected = [(9, 0, 100), (3, 100, 200), (1, 200, 300), (5, 300, 400)];
        assert_eq!(carried(&mut arbiter, 1000), expected);
    }

    #[test]
    fn frames_that_start_together_are_arbitrated_whatever_the_order_of_the_requests() {
        let mut arbiter = Arbiter::new(8);
        arbiter.request(request(50, 9, 9)).expect("room");
        assert_eq!(carried(&mut arbiter, 50), []);
        arbiter.request(request(50, 1, 1)).expect("room");
        assert_eq!(carried(&mut arbiter, 300), [(1, 50, 150), (9, 150, 250)]);
    }

    #[test]
    fn equal_urgencies_of_one_node_keep_their_order() {
        let mut arbiter = Arbiter::new(8);
        for cargo in 0..8 {
            arbiter.request(request(0, 4, cargo)).expect("room");
        }
        let order: Vec<u32> = carried(&mut arbiter, 1000).iter().map(|done| done.0).collect();
        assert_eq!(order, [0, 1, 2, 3, 4, 5, 6, 7]);
    }

    #[test]
    fn looking_more_often_changes_nothing() {
        let run = |look_every_ns| {
            let mut arbiter = Arbiter::new(16);
            let mut done = Vec::new();
            for k in 0..2000_u32 {
                let time_ns = u64::from(k) * 37;
                if k % 3 == 0 {
                    arbiter.request(request(time_ns, (k * 7919) % 13, k)).expect("room");
                }
                if time_ns % look_every_ns == 0 {
                    done.extend(carried(&mut arbiter, time_ns));
                }
            }
            done.extend(carried(&mut arbiter, u64::MAX));
            done
        };
        assert_eq!(run(37), run(37 * 10));
    }

    #[test]
    fn a_full_queue_refuses_and_counts() {
        let mut arbiter = Arbiter::new(1);
        assert_eq!(arbiter.request(request(0, 1, 1)), Ok(()));
        assert_eq!(arbiter.request(request(0, 2, 2)), Err(QueueFull));
        assert_eq!((arbiter.overflowed(), arbiter.pending()), (1, 1));
        assert_eq!(carried(&mut arbiter, 100), [(1, 0, 100)]);
    }

    #[test]
    fn a_request_for_a_time_already_decided_counts_from_there() {
        let mut arbiter = Arbiter::new(2);
        assert_eq!(arbiter.advance(500), None);
        arbiter.request(request(10, 1, 1)).expect("room");
        assert_eq!(carried(&mut arbiter, 600), [(1, 500, 600)]);
    }
}
