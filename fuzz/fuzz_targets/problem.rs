//! `cargo fuzz run --features libfuzzer problem`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::problem::run(input);
});
