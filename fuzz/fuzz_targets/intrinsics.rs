#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| spindoe_fuzz::run("intrinsics", bytes));
