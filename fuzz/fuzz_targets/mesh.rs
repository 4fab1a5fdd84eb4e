//! `cargo fuzz run --features libfuzzer mesh`

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    graintrain_fuzz::mesh::run(input);
});
