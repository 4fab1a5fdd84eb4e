//! What the paper needs and production does not, behind the feature `paper`: the methods that it compares
//! (Corona et al. 2019), its primal-dual interior point, and its tensor-train preconditioners.

mod barzilai_borwein;
mod face;
mod gpminres;
mod jacobi;
mod kucera;
pub mod pdip;
pub mod scip;
mod spectral;
mod spg;
pub mod tensor_train;
pub mod train;
pub mod train_body;
pub mod train_schur;

pub use barzilai_borwein::BarzilaiBorwein;
pub use gpminres::GpMinres;
pub use jacobi::Jacobi;
pub use kucera::Kucera;
pub use spg::SpectralProjectedGradient;
