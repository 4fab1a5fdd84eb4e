//! Everything that reads and writes, in one program: linking it once is most of the cost.

mod exchange;
mod interruptions;
mod measures;
mod open_boundaries;
mod output;
mod output_docs;
mod pauses;
mod periodic;
mod pour;
#[cfg(feature = "fclib")]
mod problem_files;
mod run;
mod scene_builtin;
mod scene_docs;
mod scene_errors;
mod scene_joints;
mod scene_laws;
mod scene_loads;
mod scene_meshes;
mod scene_robots;
mod scene_turning;
mod stages;
#[cfg(not(feature = "fclib"))]
mod without_fclib;
