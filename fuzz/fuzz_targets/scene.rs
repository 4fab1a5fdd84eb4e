//! `cargo fuzz run --features libfuzzer scene`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::scene::run(input);
});
