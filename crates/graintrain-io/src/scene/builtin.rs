//! The built-in scenes: files of the crate's folder `scenes`, compiled in.

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
pub const SCENES: &[Builtin] = &[
    Builtin {
        name: "sedimentation",
        about: "(2n+1)^3 spheres dropped into a box with a rotating mixer; the paper's first experiment",
        text: include_str!("../../scenes/sedimentation.toml"),
    },
    Builtin {
        name: "drafting",
        about: "a blade driven through (2n+1)^3 spheres; the paper's second experiment",
        text: include_str!("../../scenes/drafting.toml"),
    },
    Builtin {
        name: "direct-shear",
        about: "(3n+1)(2n+1)^2 spheres sheared in a split box under a press; the paper's third experiment",
        text: include_str!("../../scenes/direct-shear.toml"),
    },
    Builtin {
        name: "shear-box",
        about: "n^2 x 14 glass beads in a shear box under a constant normal stress sigma, with measurements; for `sweep`",
        text: include_str!("../../scenes/shear-box.toml"),
    },
    Builtin {
        name: "passive-wall",
        about: "a smooth wall pushed into a bed of spheres: Rankine's passive earth pressure",
        text: include_str!("../../scenes/passive-wall.toml"),
    },
    Builtin {
        name: "pile",
        about: "spheres from a file at rest on the ground, e.g. Kleinert's piles; --set path=FILE",
        text: include_str!("../../scenes/pile.toml"),
    },
    Builtin {
        name: "dosta",
        about: "a steel ball falls into a bed of 25 000 spheres from a file; --set path=FILE",
        text: include_str!("../../scenes/dosta.toml"),
    },
    Builtin {
        name: "excavator",
        about: "a bucket on an arm digs in grains; joints with motors",
        text: include_str!("../../scenes/excavator.toml"),
    },
    Builtin {
        name: "wheel",
        about: "a wheel from a CAD file rolls through 5 000 grains with slip: pull, sinkage, torque; --set path=FILE",
        text: include_str!("../../scenes/wheel.toml"),
    },
    Builtin {
        name: "hopper",
        about: "grains rain into a funnel, settle, and run out when its gate drops; streams, outlets, stages",
        text: include_str!("../../scenes/hopper.toml"),
    },
    Builtin {
        name: "repose",
        about: "spheres poured on a flat floor: the angle of repose; for `sweep` over rolling friction",
        text: include_str!("../../scenes/repose.toml"),
    },
    Builtin {
        name: "silo",
        about: "Janssen: what the floor of a silo carries when it sinks by 2 mm; for `sweep` over grains",
        text: include_str!("../../scenes/silo.toml"),
    },
    Builtin {
        name: "incline",
        about: "a block and a ball on an inclined plane",
        text: include_str!("../../scenes/incline.toml"),
    },
    Builtin {
        name: "stack",
        about: "n boxes on top of each other",
        text: include_str!("../../scenes/stack.toml"),
    },
];

/// The built-in scene of this name.
pub fn find(name: &str) -> Option<&'static Builtin> {
    SCENES.iter().find(|scene| scene.name == name)
}
