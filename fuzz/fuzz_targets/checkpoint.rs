//! `cargo fuzz run --features libfuzzer checkpoint`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::checkpoint::run(input);
});
