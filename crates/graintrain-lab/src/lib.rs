//! The laboratory of graintrain: published experiments run again, and the program against exact answers.
//!
//! | module | holds |
//! |---|---|
//! | [`reproduce`] | the paper's experiments run again, and a report |
//! | [`verify`] | the program against exact answers and published figures |

pub mod reproduce;
pub mod verify;
