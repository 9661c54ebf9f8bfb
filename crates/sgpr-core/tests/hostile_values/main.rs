//! Values that no arm makes, and values at the edge of what one makes, through everything that
//! reads logs or models: an answer or an error that says what to do, never a panic, and never more
//! memory than the limit of this program.
#![allow(missing_docs)]

mod logs;
#[path = "../common/memory.rs"]
mod memory;
mod models;
mod robots;

use memory::Limited;

/// What the whole program may take; beyond it the program is aborted.
const MOST: usize = 3 << 30;

#[global_allocator]
static MEMORY: Limited = Limited::new(MOST);

/// As many random cases as `SGPR_FUZZ_CASES` says; `make fuzz` says many.
fn cases(few: u32) -> u32 {
    std::env::var("SGPR_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(few)
}

#[test]
fn what_is_beyond_the_limit_is_refused() {
    assert!(Vec::<u8>::new().try_reserve_exact(MOST).is_err());
}
