//! The slot a control law fits into.

use law::qp::{ActiveSet, QpSolver};
use law::{Calibration, Decision, Law, Memory, Observation};

use crate::reference_qp::Clarabel;

pub use law::Phase;

/// A control law with its memory.
///
/// The ECU asks it once per tick, tells it what the guard made of the answer, and saves its memory
/// now and then. Nothing here may allocate, block or panic.
pub trait Controller: Send {
    /// The command for what is seen; `mark` is called at the end of each phase that took place.
    fn step(&mut self, seen: &Observation, mark: &mut dyn FnMut(Phase)) -> Decision;

    /// What was really sent, which may differ from the decision, or came without one.
    fn note_applied(&mut self, force_n: f64, steering_rad: f64);

    /// Writes the memory; the bytes used, `None` when they do not fit.
    fn save(&self, out: &mut [u8]) -> Option<usize>;

    /// Takes back a memory that [`save`](Self::save) wrote; false when it is damaged.
    fn restore(&mut self, bytes: &[u8]) -> bool;
}

/// The paper's law in the slot.
#[derive(Debug, Clone)]
pub struct LawController<S> {
    law: Law<S>,
    memory: Memory,
}

impl<S: QpSolver> LawController<S> {
    /// This law, having seen nothing.
    #[must_use]
    pub fn new(law: Law<S>) -> Self {
        Self { law, memory: Memory::new() }
    }
}

// Made here and not where they are asked for, so that the law is compiled with this crate's care
// for speed even where the command is compiled in a hurry.
impl LawController<ActiveSet> {
    /// The law with our own solver, having seen nothing.
    #[must_use]
    pub fn active_set(calibration: Calibration) -> Box<dyn Controller> {
        Box::new(Self::new(Law::new(calibration, ActiveSet)))
    }
}

impl LawController<Clarabel> {
    /// The law with the reference solver, having seen nothing.
    #[must_use]
    pub fn clarabel(calibration: Calibration) -> Box<dyn Controller> {
        Box::new(Self::new(Law::new(calibration, Clarabel)))
    }
}

impl<S: QpSolver + Send> Controller for LawController<S> {
    fn step(&mut self, seen: &Observation, mut mark: &mut dyn FnMut(Phase)) -> Decision {
        self.law.step_marked(&mut self.memory, seen, &mut mark)
    }

    fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.memory.note_applied(force_n, steering_rad);
    }

    fn save(&self, out: &mut [u8]) -> Option<usize> {
        postcard::to_slice(&self.memory, out).ok().map(|used| used.len())
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        let restored = postcard::from_bytes(bytes).ok();
        restored.map(|memory| self.memory = memory).is_some()
    }
}

/// A law with something around its steps: a fault before them, an ear after them. Its memory is
/// the law's own.
pub struct Around<F> {
    law: Box<dyn Controller>,
    step: F,
}

impl<F> Around<F>
where
    F: FnMut(&mut dyn Controller, &Observation, &mut dyn FnMut(Phase)) -> Decision + Send,
{
    /// `step` is given the law and decides when to ask it.
    pub fn new(law: Box<dyn Controller>, step: F) -> Self {
        Self { law, step }
    }
}

impl<F> Controller for Around<F>
where
    F: FnMut(&mut dyn Controller, &Observation, &mut dyn FnMut(Phase)) -> Decision + Send,
{
    fn step(&mut self, seen: &Observation, mark: &mut dyn FnMut(Phase)) -> Decision {
        (self.step)(&mut *self.law, seen, mark)
    }

    fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.law.note_applied(force_n, steering_rad);
    }

    fn save(&self, out: &mut [u8]) -> Option<usize> {
        self.law.save(out)
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.law.restore(bytes)
    }
}
