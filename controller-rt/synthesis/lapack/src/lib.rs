//! The BLAS and LAPACK routines that Clarabel's semidefinite cones call.
//!
//! Eleven routines, each for `f64` and `f32`: `gemm`, `gemv`, `symv`, `syrk`, `syr2k`, `potrf`,
//! `potrs`, `gesv`, `gesdd`, `gesvd` and `syevr`. [`dense`] says what they compute, in terms of
//! nalgebra; `abi` is the one file that speaks Fortran's calling convention (LP64, no hidden
//! lengths of strings) and the only one with `unsafe` code. There is nothing to call from Rust:
//! the crate exists to be linked.
//!
//! It takes the place of the registry's `lapack-src`, which is empty until one of its features
//! names a library to link. Whoever prefers OpenBLAS removes the workspace's patch and switches
//! Clarabel's feature `sdp-openblas` on; nothing else changes.
//!
//! What it refuses: numbers that are not finite. The decompositions then report a failure instead
//! of searching for ever.

mod abi;
pub mod dense;
