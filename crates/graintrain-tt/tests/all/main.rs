//! Tensor trains against dense algebra and published answers, in one program: linking it once is most of the cost.

mod algebra;
mod certificates;
mod complex;
mod contact_matrix;
mod cross;
mod cross_certificates;
mod dense;
mod eigen;
mod estimates;
mod evolution;
mod files;
mod fit;
mod functions;
mod gmres;
mod held_out;
mod honesty;
mod hostile_input;
mod known_ranks;
mod large_tensors;
mod modes;
mod promises;
mod solve;
mod sparse_to_train;
mod support;
mod symmetric;
mod toolbox_systems;
