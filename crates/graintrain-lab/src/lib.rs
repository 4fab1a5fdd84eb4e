//! The laboratory of graintrain: published experiments run again, and the program against exact answers.
//!
//! | module | holds |
//! |---|---|
//! | [`calibrate`] | parameters of a scene from what was measured |
//! | `page` | what the pages of reports share |
//! | [`reproduce`] | the paper's experiments run again, and a report |
//! | [`sweep`] | a scene at many values of its parameters, studies of time step and tolerance |
//! | [`verify`] | the program against exact answers and published figures |

#![warn(clippy::too_many_lines)]

pub mod calibrate;
mod page;
pub mod reproduce;
pub mod sweep;
pub mod verify;
