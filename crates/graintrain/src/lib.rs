//! Granular and multibody dynamics with hard contact.
//!
//! | module | holds |
//! |---|---|
//! | [`shape`], [`material`], [`motion`] | what bodies are made of and how they are driven |
//! | [`world`] | the state |
//! | [`contact`] | contacts and their impulses |
//! | [`error`] | what can be wrong with a world |

pub mod contact;
pub mod error;
pub mod material;
pub mod math;
pub mod motion;
pub mod plot;
pub mod shape;
pub mod stepper;
pub mod world;

pub use graintrain_ccp as ccp;
