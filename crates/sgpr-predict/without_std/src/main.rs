//! A controller without the standard library, with an allocator and a panic handler of its own.
//!
//! Standard input: bytes of the model (`u64` length, then the bytes), rate in Hz (`f64`), then
//! samples of q, dq, ddq, `[n]` each. Standard output: for each sample the torque and the
//! compensation, `[n]` each, and both once more as they are in 32 bits. It ends with 3 if anything
//! allocates after set-up.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::vec;
use alloc::vec::Vec;
use core::alloc::{GlobalAlloc, Layout};
use core::cell::UnsafeCell;
use core::ffi::{c_int, c_void};
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicUsize, Ordering};

use sgpr_predict::control::{Compensation, CompensationOptions};
use sgpr_predict::model::StreamedModel;
use sgpr_predict::stream::{Purpose, StreamOptions};

#[link(name = "c")]
unsafe extern "C" {
    fn read(file: c_int, to: *mut c_void, length: usize) -> isize;
    fn write(file: c_int, from: *const c_void, length: usize) -> isize;
    fn _exit(status: c_int) -> !;
}

const MEMORY: usize = 64 << 20;

/// Hands out memory in a row and takes none back.
struct InARow {
    memory: UnsafeCell<[u8; MEMORY]>,
    used: AtomicUsize,
    count: AtomicUsize,
}

// SAFETY: ranges that are handed out do not overlap, as `used` only grows.
unsafe impl Sync for InARow {}

// SAFETY: as above; a range lies within the memory, at a place that suits the layout.
unsafe impl GlobalAlloc for InARow {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.count.fetch_add(1, Ordering::Relaxed);
        let start = self.memory.get().cast::<u8>();
        let used = self.used.fetch_add(layout.size() + layout.align(), Ordering::Relaxed);
        if used + layout.size() + layout.align() > MEMORY {
            return core::ptr::null_mut();
        }
        let at = start.wrapping_add(used);
        at.wrapping_add(at.align_offset(layout.align()))
    }

    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
}

#[global_allocator]
static ALLOCATOR: InARow = InARow {
    memory: UnsafeCell::new([0; MEMORY]),
    used: AtomicUsize::new(0),
    count: AtomicUsize::new(0),
};

#[panic_handler]
fn panicked(_: &PanicInfo<'_>) -> ! {
    // SAFETY: ends the process.
    unsafe { _exit(101) }
}

/// The compiled `alloc` names these two for unwinding, which a program that aborts never does.
#[unsafe(no_mangle)]
pub extern "C" fn rust_eh_personality() {}

/// As above.
#[unsafe(no_mangle)]
pub extern "C" fn _Unwind_Resume() -> ! {
    // SAFETY: ends the process.
    unsafe { _exit(102) }
}

/// Fills `to`; less only where the input ends.
fn fill(to: &mut [u8]) -> usize {
    let mut done = 0;
    while done < to.len() {
        // SAFETY: the rest of the slice.
        let more = unsafe { read(0, to[done..].as_mut_ptr().cast(), to.len() - done) };
        match usize::try_from(more) {
            Ok(more) if more > 0 => done += more,
            _ => break,
        }
    }
    done
}

fn put<F: Into<f64> + Copy>(values: &[F]) {
    for value in values {
        let value: f64 = (*value).into();
        let bytes = value.to_le_bytes();
        // SAFETY: eight bytes.
        unsafe { write(1, bytes.as_ptr().cast(), bytes.len()) };
    }
}

fn number() -> Option<[u8; 8]> {
    let mut bytes = [0; 8];
    (fill(&mut bytes) == 8).then_some(bytes)
}

fn run() -> Option<c_int> {
    let mut bytes = vec![0; usize::try_from(u64::from_le_bytes(number()?)).ok()?];
    fill(&mut bytes);
    let model = StreamedModel::from_bytes(&bytes, "standard input").ok()?;
    let rate_hz = Some(f64::from_le_bytes(number()?));
    let stream =
        StreamOptions::default().with_rate_hz(rate_hz).with_purpose(Purpose::ExpectedMeasurement);
    let mut predictor = model.predictor(&stream).ok()?;
    let mut single_predictor = model.single_predictor(&stream).ok()?;
    let options = CompensationOptions::default().with_stream(stream);
    let mut compensation = Compensation::new(&model, &options).ok()?;
    let mut single_compensation = Compensation::single(&model, &options).ok()?;
    let n = model.dof();
    let mut sample: Vec<f64> = vec![0.0; 3 * n];
    let mut single: Vec<f32> = vec![0.0; 3 * n];
    let set_up = ALLOCATOR.count.load(Ordering::Relaxed);
    loop {
        for (value, single) in sample.iter_mut().zip(&mut single) {
            let Some(bytes) = number() else { return Some(0) };
            *value = f64::from_le_bytes(bytes);
            *single = *value as f32;
        }
        let (q, rest) = sample.split_at(n);
        let (dq, ddq) = rest.split_at(n);
        put(predictor.try_torque(q, dq, ddq).ok()?);
        put(compensation.torque(q, dq).ok()?);
        let (q, rest) = single.split_at(n);
        let (dq, ddq) = rest.split_at(n);
        put(single_predictor.try_torque(q, dq, ddq).ok()?);
        put(single_compensation.torque(q, dq).ok()?);
        if ALLOCATOR.count.load(Ordering::Relaxed) != set_up {
            return Some(3);
        }
    }
}

/// # Safety
/// Called once, by the start of the C library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn main(_: c_int, _: *const *const u8) -> c_int {
    run().unwrap_or(1)
}
