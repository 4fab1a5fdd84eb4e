//! What a run leaves behind: frames for ParaView and OVITO, tables, a summary.
//!
//! | module | holds |
//! |---|---|
//! | [`recorder`] | the folder of a run: what is written when |
//! | [`bodies`], [`surfaces`], [`contacts`] | a frame of each |
//! | [`vtp`], [`vtm`], [`pvd`] | the file formats of frames and their list |
//! | [`columns`] | what the columns of tables mean: `columns.json` |
//! | [`tables`] | `steps.csv`, `wrench.csv` |
//! | [`newton`] | `newton.csv` |
//! | [`summary`] | `summary.json` |

pub mod bodies;
pub mod columns;
pub mod contacts;
pub mod newton;
pub mod pvd;
pub mod recorder;
pub mod size;
pub mod summary;
pub mod surfaces;
pub mod tables;
pub mod vtm;
pub mod vtp;

pub use crate::settings::OutputSettings;
