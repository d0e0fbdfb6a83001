//! Work for the widest vector registers the machine has, found while the program runs.
//!
//! A portable build must do with the 128 bits every x86-64 has; most have 256. The work is compiled
//! for both. Neither is allowed to fuse or reorder what is written, so both give the same bits, and
//! which of them runs is as invisible as the processor's speed.

/// Work that profits from wide registers.
pub trait Work {
    /// What comes of it.
    type Result;

    /// Does it. Has to be `#[inline(always)]`, as everything below it that is to be wide.
    fn run(self) -> Self::Result;
}

#[cfg(target_arch = "x86_64")]
cpufeatures::new!(avx, "avx");

/// Does the work with the widest registers there are.
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "whether a processor has wide registers shows only when it runs")]
pub fn widest<W: Work>(work: W) -> W::Result {
    /// The work compiled for 256-bit registers.
    #[inline(never)]
    #[target_feature(enable = "avx")]
    fn with_avx<W: Work>(work: W) -> W::Result {
        work.run()
    }
    if avx::get() {
        // SAFETY: the processor has AVX, and the operating system keeps its registers.
        unsafe { with_avx(work) }
    } else {
        work.run()
    }
}

/// Square root, by the instruction that fits the registers in use.
///
/// `libm` writes the older form of the instruction; among work with wide registers that makes the
/// processor put their upper halves aside, which takes longer than many a root.
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "without the standard library there is no other way to ask for it")]
#[inline(always)]
pub fn sqrt(x: f64) -> f64 {
    use core::arch::x86_64::{_mm_cvtsd_f64, _mm_set1_pd, _mm_sqrt_pd};
    // SAFETY: every x86-64 has SSE2, and registers are all that is touched.
    unsafe { _mm_cvtsd_f64(_mm_sqrt_pd(_mm_set1_pd(x))) }
}

/// Square root.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub fn sqrt(x: f64) -> f64 {
    libm::sqrt(x)
}

/// Does the work with the registers every processor of this kind has.
#[cfg(not(target_arch = "x86_64"))]
pub fn widest<W: Work>(work: W) -> W::Result {
    work.run()
}
