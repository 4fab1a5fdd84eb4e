//! Pictures, charts and replays of graintrain's worlds and runs: no display, no network, no system fonts.
//!
//! | module | holds |
//! |---|---|
//! | [`plot`] | charts in SVG |
//! | [`render`] | pictures of a world |
//! | [`view`] | a run's folder read back; replays in one HTML page |

pub mod plot;
pub mod render;
pub mod view;
