//! The heap of every command, with a count of who uses it: the trap that a loop which allocates
//! steps into.
//!
//! It is always armed, so that what a run says about its loops is true of the program as it is
//! used. A use costs the count of one number of the thread's own.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Uses by this thread. A constant without a destructor: it is there as long as the thread is.
    static USES: Cell<u64> = const { Cell::new(0) };
}

/// The system's heap, counting.
struct Counting;

#[global_allocator]
static HEAP: Counting = Counting;

/// How often the calling thread has asked for memory or given some back.
pub fn uses() -> u64 {
    USES.get()
}

fn count() {
    USES.set(USES.get() + 1);
}

#[expect(unsafe_code, reason = "a global allocator is unsafe by its trait")]
// SAFETY: every call goes to the system's allocator with the arguments it came with; counting
// touches only a thread local that allocates nothing and is never destroyed.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_to_use_the_heap_counts_and_other_threads_do_not() {
        let before = uses();
        let mut bytes = std::hint::black_box(Vec::<u8>::with_capacity(16));
        assert_eq!(uses() - before, 1, "asking");
        bytes.reserve(1 << 20);
        assert_eq!(uses() - before, 2, "asking for more");
        drop(bytes);
        assert_eq!(uses() - before, 3, "giving back");
        drop(std::hint::black_box(vec![0_u8; 64]));
        assert_eq!(uses() - before, 5, "asking for zeros, and giving back");

        let elsewhere = std::thread::spawn(|| drop(std::hint::black_box(vec![1_u8; 64])));
        let before = uses();
        while !elsewhere.is_finished() {
            std::hint::spin_loop();
        }
        assert_eq!(uses(), before);
    }

    #[test]
    fn computing_and_looking_do_not_count() {
        let (numbers, before) = (std::hint::black_box([1_u64; 64]), uses());
        assert_eq!(numbers.iter().sum::<u64>(), 64);
        assert_eq!(uses(), before);
    }
}
