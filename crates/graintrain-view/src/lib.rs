//! Pictures, charts and replays of graintrain's worlds and runs: no display, no network, no system fonts.
//!
//! | module | holds |
//! |---|---|
//! | [`plot`] | charts in SVG |
//! | [`figures`] | the standard figures of a run |
//! | [`render`] | pictures of a world |
//! | [`film`] | the pictures of a run, from one camera |
//! | [`view`] | a run's folder read back; replays in one HTML page |

#![warn(clippy::too_many_lines)]

pub mod figures;
pub mod film;
pub mod plot;
pub mod render;
pub mod view;
