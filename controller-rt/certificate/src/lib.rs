//! What a gain of the coordination layer claims, and the check that trusts nobody.
//!
//! A [`GainFile`] has a gain, the plant and the delays it is for, and the matrices that prove it.
//! [`certify`] looks at all of that afresh: it evaluates the matrix inequalities in `f64` and in
//! exact rational arithmetic, and compares them with margins, spectra, sweeps and simulations that
//! know nothing of matrix inequalities. Nothing here solves one: the crate shares no code with the
//! crate `synthesis`, whose solver may be as wrong as it likes.
//!
//! ```
//! use certificate::{Conditions, library, proofs};
//!
//! let (_, file) = library::named("published").expect("built in");
//! assert!(proofs(&file, &Conditions::of(&file, 0.05)).is_certified());
//! ```

pub mod check;
mod exact;
mod file;
mod form;
mod gain;
pub mod library;
pub mod margin;
mod proof;
pub mod simulation;
pub mod spectrum;
mod verdict;

pub use file::{CouplingProofs, FileError, GainFile, PlatoonProof, VERSION, VehicleProofs};
pub use form::Channel;
pub use gain::{Corner, DelayBound, Gain, Plants, Rate};
pub use proof::{Jensen, Wirtinger};
pub use verdict::{
    Conditions, Finding, Threshold, Verdict, certify, mixed_string_bound, proofs, stability,
    string_bound,
};
