//! Memory with a limit, for programs that must keep to one.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

use cap::Cap;

/// Memory up to a limit, beyond which the program is aborted: here if too little is left for a
/// backtrace, in which the standard library would wait for itself. What faer reserves for the
/// products of a thread, twice as much as the largest cache holds, is not counted: it is address
/// space, of which a product touches what it needs, and the only thing that is asked for by the
/// page.
pub struct Limited(Cap<System>);

const PAGE: usize = 4096;

/// What a backtrace takes, and more.
const BACKTRACE: usize = 64 << 20;

impl Limited {
    pub const fn new(bytes: usize) -> Self {
        Self(Cap::new(System, bytes))
    }

    fn beneath(&self, layout: Layout) -> &dyn GlobalAlloc {
        if layout.align() < PAGE { &self.0 } else { &System }
    }

    fn given(&self, at: *mut u8) -> *mut u8 {
        if at.is_null() && self.0.remaining() < BACKTRACE {
            let _ = std::io::stderr().write_all(b"more memory than the limit of this program\n");
            std::process::abort();
        }
        at
    }
}

// SAFETY: one of two allocators does all; what was asked for from one goes back to the same, as the
// alignment says.
unsafe impl GlobalAlloc for Limited {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller says.
        self.given(unsafe { self.beneath(layout).alloc(layout) })
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller says.
        unsafe { self.beneath(layout).dealloc(at, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller says.
        self.given(unsafe { self.beneath(layout).alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as the caller says.
        self.given(unsafe { self.beneath(layout).realloc(at, layout, size) })
    }
}
