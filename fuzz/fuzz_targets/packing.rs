//! `cargo fuzz run --features libfuzzer packing`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::packing::run(input);
});
