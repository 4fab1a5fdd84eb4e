use super::camera::{Bounds, Camera};
use super::color::{categorical, viridis};
use super::primitive::{Form, Look, Primitive};
use super::raster::{Atmosphere, cast};
use super::*;
use graintrain::contact::{Contact, ContactSet};
use graintrain::material::Materials;
use graintrain::math::Quat;
use graintrain::shape::{Geometry, HalfSpace};
use graintrain::world::Body;
use proptest::prelude::*;

const PLAIN: Atmosphere = Atmosphere { background: [1.0; 3], haze: [1e9, 2e9] };

/// A camera at the origin that looks along +x.
fn camera(focal: f64, center: f64) -> Camera {
    Camera {
        eye: Vec3::ZERO,
        right: Vec3::NEG_Y,
        up: Vec3::Z,
        forward: Vec3::X,
        focal,
        center: [center, center],
    }
}

fn ball(center: Vec3, radius: f64) -> Primitive {
    Primitive { form: Form::Ball { center, radius }, color: [0.2, 0.4, 0.8], look: Look::Solid }
}

#[test]
fn a_ball_covers_the_pixels_of_its_silhouette() {
    // On the axis the silhouette is a circle of radius focal r / sqrt(d^2 - r^2), wider than focal r / d.
    let (focal, distance, radius) = (400.0, 3.0, 1.0);
    let pixels = cast(&[ball(distance * Vec3::X, radius)], &camera(focal, 200.0), 400, 400, &PLAIN);
    let covered = pixels.iter().filter(|pixel| pixel.depth.is_finite()).count() as f64;
    let disc =
        std::f64::consts::PI * focal * focal * radius * radius / (distance * distance - radius * radius);
    assert!((covered / disc - 1.0).abs() < 2e-3, "{covered} of {disc}");
    let nearest = pixels.iter().map(|pixel| pixel.depth).fold(f32::INFINITY, f32::min);
    assert!((nearest - 2.0).abs() < 1e-4);
}

#[test]
fn off_axis_the_silhouette_is_the_ellipse_that_a_cone_cuts() {
    // The two tangents in the plane of the axis and the ball's centre give its ends.
    let (focal, a, d, r) = (300.0, 1.5, 4.0, 0.8);
    let camera = camera(focal, 300.0);
    let center = Vec3::new(d, -a, 0.0);
    let rectangle = camera.ball_rectangle(center, r).unwrap();
    let (angle, half) = ((a / d).atan(), (r / a.hypot(d)).asin());
    let expected = [(angle - half).tan(), (angle + half).tan()].map(|t| 300.0 + focal * t);
    assert!((rectangle[0] - expected[0]).abs() < 1e-9 && (rectangle[2] - expected[1]).abs() < 1e-9);
    let pixels = cast(&[ball(center, r)], &camera, 600, 600, &PLAIN);
    let covered = pixels.iter().filter(|pixel| pixel.depth.is_finite()).count() as f64;
    // Area of the ellipse: pi focal^2 r^2 sqrt(a^2 + d^2 - r^2) / (d^2 - r^2)^(3/2).
    let area = std::f64::consts::PI * focal * focal * r * r * (a * a + d * d - r * r).sqrt()
        / (d * d - r * r).powf(1.5);
    assert!((covered / area - 1.0).abs() < 3e-3, "{covered} of {area}");
}

#[test]
fn nearer_bodies_hide_farther_ones_in_any_order() {
    let near = Primitive { color: [1.0, 0.0, 0.0], ..ball(2.0 * Vec3::X, 0.3) };
    let far = Primitive { color: [0.0, 0.0, 1.0], ..ball(4.0 * Vec3::X, 1.0) };
    let camera = camera(200.0, 100.0);
    for order in [[near, far], [far, near]] {
        let pixels = cast(&order, &camera, 200, 200, &PLAIN);
        let middle = pixels[100 * 200 + 100];
        assert!((f64::from(middle.depth) - 1.7).abs() < 1e-3);
        assert!(middle.color[0] > middle.color[2] + 0.3);
        // Beside the near ball the far one shows.
        let beside = pixels[100 * 200 + 145];
        assert!(beside.color[2] > beside.color[0] + 0.3 && beside.depth.is_finite());
    }
}

#[test]
fn a_pane_tints_what_is_behind_it_and_nothing_in_front() {
    let grain = ball(3.0 * Vec3::X, 1.0);
    let pane = |x: f64| Primitive {
        form: Form::Box { center: x * Vec3::X, rotation: Quat::IDENTITY, half: Vec3::new(0.01, 3.0, 3.0) },
        color: [0.0; 3],
        look: Look::Glass,
    };
    let camera = camera(200.0, 100.0);
    let color = |primitives: &[Primitive]| cast(primitives, &camera, 200, 200, &PLAIN)[100 * 200 + 100].color;
    let plain = color(&[grain]);
    assert_eq!(color(&[grain, pane(6.0)]), plain);
    let behind = color(&[grain, pane(1.0)]);
    assert!((behind[0] - 0.93 * plain[0]).abs() < 1e-9);
}

/// Signed distance to a form by its definition, the oracle of the ray tests.
fn distance(form: &Form, p: Vec3) -> f64 {
    let along = |from: Vec3, to: Vec3| {
        let axis = (to - from).normalize();
        let height = (p - from).dot(axis);
        (height, (p - from - height * axis).length(), from.distance(to))
    };
    match *form {
        Form::Ball { center, radius } => p.distance(center) - radius,
        Form::Box { center, rotation, half } => {
            let q = (rotation.conjugate() * (p - center)).abs() - half;
            q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
        }
        Form::Capsule { from, to, radius } => {
            let (height, across, length) = along(from, to);
            (height - height.clamp(0.0, length)).hypot(across) - radius
        }
        Form::Cylinder { from, to, radius } => {
            let (height, across, length) = along(from, to);
            let (x, y) = (across - radius, (height - 0.5 * length).abs() - 0.5 * length);
            x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
        }
        Form::Triangle { .. } => f64::INFINITY,
    }
}

fn any_vector() -> impl Strategy<Value = Vec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(|[x, y, z]: [f64; 3]| Vec3::new(x, y, z))
}

fn any_form() -> impl Strategy<Value = Form> {
    (0..4, any_vector(), any_vector(), 0.1..1.0, any_vector()).prop_filter_map(
        "degenerate",
        |(kind, a, b, radius, turn): (i32, Vec3, Vec3, f64, Vec3)| {
            let rotation = Quat::from_axis_angle(turn.try_normalize()?, 2.0);
            (a.distance(b) > 0.05).then_some(match kind {
                0 => Form::Ball { center: a, radius },
                1 => Form::Box { center: a, rotation, half: b.abs() + 0.05 },
                2 => Form::Capsule { from: a, to: b, radius },
                _ => Form::Cylinder { from: a, to: b, radius },
            })
        },
    )
}

proptest! {
    /// A hit lies on the surface, everything before it is outside, and the normal is the distance's gradient;
    /// a miss passes the form at a distance everywhere.
    #[test]
    fn rays_meet_surfaces_where_the_distance_vanishes(form in any_form(), target in any_vector(), from in any_vector()) {
        let origin = 6.0 * from.try_normalize().unwrap_or(Vec3::X);
        let direction = target - origin;
        match form.meet(origin, direction) {
            Some(hit) => {
                let p = origin + hit.depth * direction;
                prop_assert!(distance(&form, p).abs() < 1e-9);
                for k in 0..100 {
                    let before = origin + hit.depth * (1.0 - 1e-6) * f64::from(k) / 100.0 * direction;
                    prop_assert!(distance(&form, before) > 0.0);
                }
                prop_assert!((hit.normal.length() - 1.0).abs() < 1e-9);
                let step = 1e-6;
                prop_assert!((distance(&form, p + step * hit.normal) - step).abs() < 1e-9);
            }
            None => {
                for k in 0..400 {
                    prop_assert!(distance(&form, origin + f64::from(k) / 200.0 * direction) > -1e-9);
                }
            }
        }
    }

    /// The rectangle used for binning holds the image of every surface point that a ray meets.
    #[test]
    fn rectangles_hold_the_image(form in any_form(), target in any_vector(), from in any_vector()) {
        let eye = 5.0 * from.try_normalize().unwrap_or(Vec3::X);
        let camera = Camera::fit(&Bounds::EMPTY.with(Vec3::ZERO, 2.5).corners(), -eye, Vec3::Z, [0.0, 0.0, 100.0, 100.0]);
        if let Some(hit) = form.meet(camera.eye, target - camera.eye) {
            let [x, y] = camera.project(camera.eye + hit.depth * (target - camera.eye)).unwrap();
            let [left, top, right, bottom] = form.rectangle(&camera);
            prop_assert!(left <= x + 1e-9 && x <= right + 1e-9 && top <= y + 1e-9 && y <= bottom + 1e-9);
        }
    }

    /// The automatic view shows all points, and none of its margins could be cut on both axes.
    #[test]
    fn the_automatic_view_is_tight(points in prop::collection::vec(any_vector(), 4..20), from in any_vector()) {
        let region = [30.0, 20.0, 400.0, 270.0];
        let camera = Camera::fit(&points, from, Vec3::Z, region);
        let seen: Vec<[f64; 2]> = points.iter().map(|&point| camera.project(point).unwrap()).collect();
        let range = |axis: usize| {
            seen.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[axis]), b.max(p[axis])])
        };
        let (x, y) = (range(0), range(1));
        prop_assert!(x[0] > region[0] - 1e-6 && x[1] < region[2] + 1e-6);
        prop_assert!(y[0] > region[1] - 1e-6 && y[1] < region[3] + 1e-6);
        let full = (x[0] - region[0]).abs() + (region[2] - x[1]).abs() < 1e-6
            || (y[0] - region[1]).abs() + (region[3] - y[1]).abs() < 1e-6;
        prop_assert!(full, "{x:?} {y:?}");
    }
}

#[test]
fn triangles_are_met_from_both_sides() {
    let form = Form::Triangle { corners: [Vec3::ZERO, Vec3::X, Vec3::Y] };
    let hit = form.meet(Vec3::new(0.2, 0.2, 2.0), Vec3::NEG_Z).unwrap();
    assert_eq!((hit.depth, hit.normal), (2.0, Vec3::Z));
    let hit = form.meet(Vec3::new(0.2, 0.2, -3.0), Vec3::Z).unwrap();
    assert_eq!((hit.depth, hit.normal), (3.0, Vec3::NEG_Z));
    assert_eq!(form.meet(Vec3::new(0.6, 0.6, 2.0), Vec3::NEG_Z), None);
}

#[test]
fn the_colour_map_rises_in_lightness_and_clamps() {
    assert_eq!(viridis(-1.0), viridis(0.0));
    assert_eq!(viridis(f64::NAN), viridis(0.0));
    assert_eq!(viridis(2.0), [253.0 / 255.0, 231.0 / 255.0, 37.0 / 255.0]);
    let lightness = |fraction: f64| {
        let [r, g, b] = viridis(fraction);
        0.2126 * r.powf(2.2) + 0.7152 * g.powf(2.2) + 0.0722 * b.powf(2.2)
    };
    assert!((0..200).all(|i| lightness(f64::from(i) / 200.0) < lightness(f64::from(i + 1) / 200.0)));
    assert_ne!(categorical(0), categorical(1));
}

#[test]
fn every_glyph_is_drawn_inside_its_cell() {
    for c in
        ('!'..='~').filter(|c| !"$&@\\`{|}~".contains(*c)).chain(['\u{2212}', '\u{b5}', '\u{b2}', '\u{b3}'])
    {
        let strokes = font::strokes(c);
        assert!(!strokes.is_empty(), "{c}");
        for [x, y] in strokes.into_iter().flatten() {
            assert!(x >= 0.0 && x < font::advance(c) && (-0.4..=1.2).contains(&y), "{c}");
        }
    }
    let missing = font::strokes('\u{4e00}');
    let known: Vec<char> = ('!'..='~').filter(|&c| font::strokes(c) == missing).collect();
    assert_eq!(known.iter().collect::<String>(), "$&@\\`{|}~");
}

/// Two loaded grains on a half-space in front of a wall.
fn small_world() -> World {
    let mut materials = Materials::default();
    let stone = materials.add("stone", 1000.0).unwrap();
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), materials).unwrap();
    let sphere = world.add_geometry(Geometry::sphere(0.1).unwrap());
    let ground = world.add_geometry(Geometry::single(graintrain::shape::Shape::Plane(HalfSpace)).unwrap());
    let fixed = world.add_motion(graintrain::motion::Motion::fixed()).unwrap();
    world.add_body(Body { motion: fixed, ..Body::new(ground, stone, Vec3::ZERO) }).unwrap();
    for (x, speed) in [(0.0, 0.0), (0.2, 2.0)] {
        let body = Body::new(sphere, stone, Vec3::new(x, 0.0, 0.1));
        world.add_body(Body { velocity: speed * Vec3::X, ..body }).unwrap();
    }
    let contact = Contact {
        body_a: 2,
        body_b: 1,
        identity: 1,
        point: Vec3::new(0.1, 0.0, 0.1),
        normal: Vec3::X,
        gap: 0.0,
        lead: Vec3::ZERO,
        image: [0; 3],
    };
    world.contacts = ContactSet {
        contacts: vec![contact],
        impulse: vec![3.0 * Vec3::X],
        friction: vec![0.3],
        ..ContactSet::default()
    };
    world
}

#[test]
fn a_picture_has_its_colours_and_does_not_depend_on_threads() {
    let world = small_world();
    let settings = RenderSettings { width: 240, height: 180, step: 0.5, ..RenderSettings::default() };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&world, &settings).unwrap())
    };
    let image = on(1);
    assert_eq!(image, on(3));
    // The resting grain is violet, the fast one yellow.
    let count = |test: fn([u8; 3]) -> bool| {
        (0..180)
            .flat_map(|y| (0..200).map(move |x| (x, y)))
            .filter(|&(x, y)| test(image.bytes_at(x, y)))
            .count()
    };
    assert!(count(|[r, g, b]| b > r && r > g.saturating_add(10)) > 500);
    assert!(count(|[r, g, b]| r.min(g) > b.saturating_add(60)) > 500);
    let mut file = Vec::new();
    image.write_png(&mut file).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width, info.height), (240, 180));
    assert_eq!(bytes[..3], image.bytes_at(0, 0));
}

#[test]
fn force_chains_join_the_centres_and_carry_newtons() {
    let world = small_world();
    let settings = RenderSettings { force_chains: true, step: 0.5, ..RenderSettings::default() };
    assert_eq!(subject::contact_force(&world, 0.5), [0.0, 6.0, 6.0]);
    let grains = subject::grains(&world);
    assert_eq!(grains, [1, 2]);
    let bounds = subject::bounds(&world, &grains);
    let (primitives, legend) = subject::primitives(&world, &grains, &bounds, &camera(100.0, 50.0), &settings);
    let tubes: Vec<&Form> =
        primitives.iter().map(|p| &p.form).filter(|form| matches!(form, Form::Capsule { .. })).collect();
    let end = Vec3::new(0.1, 0.0, 0.1);
    assert_eq!(tubes.len(), 2);
    assert_eq!(*tubes[0], Form::Capsule { from: world.bodies.position[2], to: end, radius: 0.45 * 0.1 });
    assert_eq!(legend.unwrap().range, [0.0, 6.0]);
}

#[test]
fn unusable_settings_are_errors() {
    let world = small_world();
    let with = |change: fn(&mut RenderSettings)| {
        let mut settings = RenderSettings::default();
        change(&mut settings);
        render(&world, &settings)
    };
    assert!(matches!(with(|s| s.width = 0), Err(RenderError::Size { .. })));
    assert!(matches!(with(|s| s.step = f64::NAN), Err(RenderError::Value { .. })));
    assert!(matches!(with(|s| s.range = Some([1.0, 1.0])), Err(RenderError::Value { .. })));
    assert!(matches!(with(|s| s.view[0] = f64::INFINITY), Err(RenderError::Value { .. })));
    assert!("colour".parse::<ColorBy>().is_err());
}

/// A tool over the bed stays solid although all grains are on one side of its faces, a plate before them is
/// glass, and a gate that has dropped away does not set the frame.
#[test]
fn tools_are_no_walls_and_what_is_far_sets_no_frame() {
    let mut world = small_world();
    let stone = world.bodies.material[0];
    let fixed = world.bodies.motion[0];
    let mut add = |half: Vec3, position: Vec3| {
        let geometry = world.add_geometry(Geometry::cuboid(half).unwrap());
        world.add_body(Body { motion: fixed, ..Body::new(geometry, stone, position) }).unwrap().index()
    };
    let tool = add(Vec3::new(0.01, 0.01, 0.04), Vec3::new(-0.02, 0.05, 0.3));
    let plate = add(Vec3::new(0.3, 0.01, 0.2), Vec3::new(0.1, -0.2, 0.2));
    let gate = add(Vec3::new(0.3, 0.3, 0.01), Vec3::new(0.1, 0.0, -1.0));
    let grains = subject::grains(&world);
    let bounds = subject::bounds(&world, &grains);
    assert!(bounds.low.z > -0.1, "the gate is out of the picture: {bounds:?}");
    let centers: Vec<Vec3> = grains.iter().map(|&body| world.bodies.position[body]).collect();
    let are_walls = [tool, plate, gate].map(|body| subject::stands_around(&world, body, &centers));
    assert_eq!(are_walls, [false, true, true]);
    let eye = Vec3::new(0.1, -2.0, 0.3);
    let camera =
        Camera { eye, right: Vec3::X, up: Vec3::Z, forward: Vec3::Y, focal: 300.0, center: [100.0; 2] };
    let (primitives, _) = subject::primitives(&world, &grains, &bounds, &camera, &RenderSettings::default());
    let glass: Vec<&Form> = primitives.iter().filter(|p| p.look == Look::Glass).map(|p| &p.form).collect();
    assert!(
        matches!(glass[..], [Form::Box { center, .. }] if *center == world.bodies.position[plate]),
        "{glass:?}"
    );
}

/// The point of "1.100 s" is as black as its digits at the size that pictures have.
#[test]
fn a_decimal_point_is_seen() {
    let mut image = Image { width: 40, height: 30, pixels: vec![[1.0; 3]; 1200] };
    image.text(10.0, 20.0, ".", 11.0, image::Align::Left, [0.0; 3]);
    let ink: f64 = image.pixels.iter().map(|pixel| 1.0 - pixel[0]).sum();
    assert!(ink > 4.0, "{ink} pixels of ink");
}
