//! `graintrain scenes`: the built-in scenes.

use crate::error::Failure;
use crate::scene_failure::scene_failure;
use crate::terminal::answer;
use graintrain_io::scene::{SceneError, builtin};
use std::process::ExitCode;

/// List the built-in scenes, or print the file of one
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  graintrain scenes\n  graintrain scenes sedimentation > mine.toml")]
pub struct Arguments {
    /// Print this scene's file
    name: Option<String>,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let text = match &arguments.name {
        Some(name) => match builtin::find(name) {
            Some(scene) => scene.text.to_string(),
            None => return Err(scene_failure(SceneError::unknown_scene(name))),
        },
        None => {
            let width = builtin::SCENES.iter().map(|scene| scene.name.len()).max().unwrap_or(0);
            let line = |scene: &builtin::Builtin| format!("{:width$}  {}\n", scene.name, scene.about);
            builtin::SCENES.iter().map(line).collect()
        }
    };
    answer(text)?;
    Ok(ExitCode::SUCCESS)
}
