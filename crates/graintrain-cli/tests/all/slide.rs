//! A scene whose answers are known in closed form, for studies of scenes.

/// A block slides to rest: the way is v^2 / (2 mu g), on it x(t) = v t - mu g t^2 / 2.
pub const SLIDE: &str = r#"
[parameters]
mu = 0.3
speed = "1 m/s"
[time]
step = "2 ms"
end = "0.8 s"
[solver]
friction = "coulomb"
tolerance = 1e-8
[material.a]
friction = "mu"
[body.floor]
shape = { plane = {} }
[body.block]
shape = { box = { size = [0.4, 0.4, 0.1] } }
position = [0, 0, 0.05]
velocity = ["speed", 0, 0]
[measure.block]
motion = true
energy = true
"#;
