//! `cargo fuzz run --features libfuzzer robot`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::robot::run(input);
});
