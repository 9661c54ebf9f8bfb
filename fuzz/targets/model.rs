#![no_main]

#[path = "../../crates/sgpr-core/tests/corpus/attempts.rs"]
mod attempts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| attempts::model(bytes));
