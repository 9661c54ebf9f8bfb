//! Memory with a limit, for programs that must keep to one.

use std::alloc::{GlobalAlloc, Layout, System};

use cap::Cap;

/// Memory up to a limit, beyond which the program is aborted. What faer reserves for the products of a thread, twice as much as
/// the largest cache holds, is not counted: it is address space, of which a product touches what it needs, and the only
/// thing that is asked for by the page.
pub struct Limited(Cap<System>);

const PAGE: usize = 4096;

impl Limited {
    pub const fn new(bytes: usize) -> Self {
        Self(Cap::new(System, bytes))
    }
}

// SAFETY: what was asked for from one of the two allocators goes back to the same, as the alignment says.
unsafe impl GlobalAlloc for Limited {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise is that of the allocator beneath.
        unsafe { if layout.align() < PAGE { self.0.alloc(layout) } else { System.alloc(layout) } }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is that of the allocator beneath.
        unsafe { if layout.align() < PAGE { self.0.dealloc(at, layout) } else { System.dealloc(at, layout) } }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise is that of the allocator beneath.
        unsafe { if layout.align() < PAGE { self.0.alloc_zeroed(layout) } else { System.alloc_zeroed(layout) } }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's promise is that of the allocator beneath.
        unsafe {
            if layout.align() < PAGE { self.0.realloc(at, layout, size) } else { System.realloc(at, layout, size) }
        }
    }
}
