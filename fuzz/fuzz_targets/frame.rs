//! `cargo fuzz run --features libfuzzer frame`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::frame::run(input);
});
