//! The graintrain command line.
fn main() {}
