//! The built-in scenes: files of the folder `scenes`, compiled in.

/// A built-in scene.
#[derive(Clone, Copy, Debug)]
pub struct Builtin {
    /// Name on the command line.
    pub name: &'static str,
    /// One line for people.
    pub about: &'static str,
    /// The scene file.
    pub text: &'static str,
}

/// All built-in scenes.
pub const SCENES: &[Builtin] = &[Builtin {
    name: "sedimentation",
    about: "(2n+1)^3 spheres dropped into a box with a rotating mixer (the paper's first experiment)",
    text: include_str!("../../../../scenes/sedimentation.toml"),
}];

/// The built-in scene of this name.
pub fn find(name: &str) -> Option<&'static Builtin> {
    SCENES.iter().find(|scene| scene.name == name)
}
