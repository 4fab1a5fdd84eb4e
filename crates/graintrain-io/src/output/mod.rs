//! What a run leaves behind: frames for ParaView and OVITO, tables, a summary.
//!
//! | module | holds |
//! |---|---|
//! | [`folder`] | the folder of a run, held by one process |
//! | [`recorder`] | what is written into it, and when |
//! | [`bodies`], [`surfaces`], [`contacts`] | a frame of each |
//! | [`vtp`], [`vtm`], [`pvd`] | the file formats of frames and their list |
//! | [`columns`] | what the columns of tables mean: `columns.json` |
//! | [`tables`] | `steps.csv`, `wrench.csv` |
//! | [`newton`] | `newton.csv` |
//! | [`exchange`], `vtkhdf` (feature `fclib`) | frames for other programs |
//! | [`summary`] | `summary.json` |

pub mod bodies;
pub mod columns;
pub mod contacts;
pub mod exchange;
pub mod folder;
pub mod newton;
pub mod pvd;
pub mod recorder;
pub mod size;
pub mod summary;
pub mod surfaces;
pub mod tables;
#[cfg(feature = "fclib")]
pub mod vtkhdf;
pub mod vtm;
pub mod vtp;

pub use crate::settings::OutputSettings;
