//! The two-track truck against theory.
