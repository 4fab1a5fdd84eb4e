"""Worlds built in code."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain
from graintrain import Function, Motion, Shape


def test_an_incline_holds_or_lets_slide():
    for mu, slides in [(0.6, False), (0.4, True)]:
        angle = np.arctan(0.5)
        world = graintrain.World(gravity=9.81 * np.array([np.sin(angle), 0, -np.cos(angle)]), step=1e-3, envelope=1e-3, tolerance=1e-8)
        world.add_material("wood", 600, friction=mu)
        world.add_plane(material="wood")
        block = world.add_body(Shape.box((0.1, 0.1, 0.05)), (0, 0, 0.05), material="wood")
        world.run(0.5)
        # v = g (sin - mu cos) t, up to the gap that relaxed friction lets a sliding body rise to.
        speed = 9.81 * (np.sin(angle) - mu * np.cos(angle)) * 0.5 if slides else 0.0
        assert world.velocities[block, 0] == pytest.approx(speed, rel=1e-3, abs=1e-5)


def test_materials_pair_by_the_smaller_number():
    world = graintrain.World()
    world.add_material("steel", 7800, friction=0.5, restitution=0.6)
    world.add_material("rubber", 1100, friction=0.9)
    assert world.materials == ["default", "steel", "rubber"]
    assert world.friction("steel") == 0.5 and world.friction("steel", "rubber") == 0.5
    world.set_pair("steel", "rubber", 0.8)
    assert world.friction("rubber", "steel") == 0.8
    with pytest.raises(graintrain.ModelError, match="steel"):
        world.add_material("steel", 7800)
    with pytest.raises(KeyError, match="steel"):
        world.add_body(Shape.sphere(1.0), material="steal")
    with pytest.raises(graintrain.ModelError, match="friction"):
        world.add_material("ice", 900, friction=-1.0)
    assert world.materials == ["default", "steel", "rubber"]


def rolled(resistance):
    """How fast a ball still rolls after half a second, and the moment on it in the last step."""
    world = graintrain.World(step=1e-3, friction="coulomb")
    world.set_pair("default", "default", 0.5, rolling_friction=resistance)
    world.add_plane()
    ball = world.add_body(
        Shape.sphere(0.1), (0.0, 0.0, 0.1), velocity=(1.0, 0.0, 0.0), angular_velocity=(0.0, 10.0, 0.0)
    )
    world.run(steps=500)
    return world.velocities[ball, 0], np.abs(world.contacts.moments).max() / 1e-3, world.masses[ball]


def test_rolling_friction():
    # The ball decelerates by 5/7 g mu_r / R, where mu_r is 0.01 R.
    speed, moment, mass = rolled(0.01)
    assert speed == pytest.approx(1.0 - 0.5 * 5 / 7 * 9.81 * 0.01, abs=1e-3)
    assert moment == pytest.approx(0.001 * mass * 9.81, rel=1e-2)
    assert rolled("1 mm")[0] == pytest.approx(speed, abs=1e-9)
    assert rolled(None)[:2] == pytest.approx((1.0, 0.0), abs=1e-3)
    with pytest.raises(ValueError, match="rolling_friction"):
        rolled("1 kg")
    with pytest.raises(graintrain.ModelError, match="rolling"):
        rolled(-0.1)


def test_mass_and_inertia():
    world = graintrain.World()
    box = world.add_body(Shape.box((0.1, 0.2, 0.3)))
    assert world.masses[box] == pytest.approx(48.0)
    np.testing.assert_allclose(np.diag(world.inertias[box]), 48.0 / 3 * np.array([0.13, 0.10, 0.05]))
    given = world.add_body(Shape.sphere(0.1), (1, 0, 0), mass=2.0, inertia=np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(world.inertias[given], np.diag([1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match="both"):
        world.add_body(Shape.sphere(0.1), mass=2.0)
    with pytest.raises(graintrain.ModelError, match="positive definite"):
        world.add_body(Shape.sphere(0.1), mass=2.0, inertia=np.diag([1.0, -2.0, 3.0]))
    with pytest.raises(graintrain.ModelError, match="no volume"):
        world.add_body(Shape.plane())
    assert len(world) == 2


def test_elastic_and_cohesive_pairs():
    world = graintrain.World(step=1e-3, tolerance=1e-9)
    world.add_body(Shape.plane(), motion=Motion.fixed())
    ball = world.add_body(Shape.sphere(0.1), (0, 0, 0.1))
    with pytest.raises(graintrain.ModelError, match="damping"):
        world.set_pair("default", "default", 0.5, 0.3, stiffness=1e4)
    with pytest.raises(graintrain.ModelError, match="cohesion"):
        world.set_pair("default", "default", 0.5, cohesion=-1.0)
    world.set_pair("default", "default", 0.5, stiffness=1e4, damping=200.0)
    for _ in range(1000):
        world.step()
    np.testing.assert_allclose(0.1 - world.positions[ball, 2], world.masses[ball] * 9.81 / 1e4, rtol=1e-4)
    world.set_pair("default", "default", 0.5, 0.3, stiffness=0.0, cohesion=0.1)


def test_shapes():
    assert Shape.capsule(0.5, 0.1).volume == pytest.approx(np.pi * 0.01 * (1.0 + 4 / 30))
    assert Shape.cylinder(0.5, 0.1).volume == pytest.approx(np.pi * 0.01)
    assert Shape.cone(0.6, 0.1).volume == pytest.approx(np.pi * 0.01 * 0.2)
    assert Shape.cone(0.6, 0.1, 0.1).volume == pytest.approx(np.pi * 0.01 * 0.6)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    solid = Shape.mesh(corners, faces, solid=True)
    assert solid.volume == pytest.approx(1 / 6)
    np.testing.assert_allclose(solid.center, 0.25)
    hull = Shape.hull(np.vstack([corners, [[0.2, 0.2, 0.2], [0.5, 0, 0]]]))
    assert hull.volume == pytest.approx(1 / 6)
    np.testing.assert_allclose(hull.center, 0.25)
    dumbbell = Shape.compound([(Shape.sphere(0.1), (0, 0, 0)), (Shape.sphere(0.1), (0.4, 0, 0), (0, 0, 0, 1))])
    np.testing.assert_allclose(dumbbell.center, [0.2, 0, 0], atol=1e-15)
    for wrong, message in [
        (lambda: Shape.sphere(-1.0), "radius"),
        (lambda: Shape.hull(corners[:3]), "in a plane"),
        (lambda: Shape.mesh(corners, [[0, 1, 4]]), "vertex 4"),
        (lambda: Shape.mesh(corners, [[0, 1, 2.5]]), "2.5"),
        (lambda: Shape.mesh(corners[:, :2], faces), r"vertices has the shape \(4, 2\)"),
        (lambda: Shape.mesh(corners, faces[:3], solid=True), "not closed"),
    ]:
        with pytest.raises(ValueError, match=message):
            wrong()
    with pytest.raises(TypeError, match=r"parts\[0\]"):
        Shape.compound([Shape.sphere(0.1)])


def test_motions_follow_their_functions():
    world = graintrain.World(step=1e-3)
    shake = Motion.translating((1, 0, 0), Function.sinusoidal(0.2, 0.1))
    ramp = Motion.translating((0, 1, 0), Function.table([0, 1], [0, 2]))
    wheel = Motion.rotating((0, 0, 0), (0, 0, 5), 2.0)
    late = Motion.translating((0, 0, 1), Function.delayed(0.05, 1.0))
    box = Shape.box((0.01, 0.01, 0.01))
    bodies = [world.add_body(box, (k, 0, 0), motion=m) for k, m in enumerate([shake, ramp, wheel, late])]
    slider = Motion.fixed().with_free([True, False, False, False, False, False])
    world.add_body(box, (9, 0, 0), motion=slider, velocity=(0.5, 0, 0))
    world.run(0.1)
    x = world.positions
    assert x[bodies[0], 0] == pytest.approx(0.0, abs=1e-12)
    assert x[bodies[1], 1] == pytest.approx(0.01)
    np.testing.assert_allclose(x[bodies[2]], [2 * np.cos(0.2), 2 * np.sin(0.2), 0], atol=1e-9)
    assert x[bodies[3], 2] == pytest.approx(0.05)
    np.testing.assert_allclose(x[-1], [9.05, 0, 0], rtol=1e-12)
    assert Function.table([0, 1], [0, 2])(0.25) == 0.5
    with pytest.raises(graintrain.ModelError, match="ascend"):
        Function.table([1, 0], [0, 2])
    with pytest.raises(TypeError, match="function"):
        Motion.translating((1, 0, 0), "fast")


def test_loads():
    world = graintrain.World(gravity=(0, 0, 0), step=1e-3)
    ball = Shape.sphere(0.1)
    for x in range(4):
        world.add_body(ball, (x, 0, 0), name=f"ball{x}")
    mass = world.masses[0]
    world.add_force((1, 0, 0), "ball0", function=Function.table([0, 1], [0, 1]))
    world.add_torque((0, 0, 1.0), 1)
    world.add_field((0, 0, -2.0), ["ball2"])
    world.add_drag(linear=0.5, bodies=[3], medium=(0, 1.0, 0))
    world.add_force((0, 7.0, 0), region={"min": (5, 5, 5), "max": (6, 6, 6)})
    world.run(0.1)
    assert world.velocities[0, 0] == pytest.approx(0.005 / mass, rel=1e-12)
    assert world.angular_velocities[1, 2] == pytest.approx(0.1 / (0.4 * mass * 0.01), rel=1e-12)
    assert world.velocities[2, 2] == pytest.approx(-0.2, rel=1e-12)
    assert world.velocities[3, 1] == pytest.approx(1 - np.exp(-0.05 / mass), rel=1e-3)
    assert world.last_report.load_work != 0.0
    assert not world.forces.any(), "loads leave the program's own forces alone"
    for wrong in [{"min": (0, 0, 0)}, {"radius": 1.0}]:
        with pytest.raises(ValueError, match="a region is"):
            world.add_drag(region=wrong)
    with pytest.raises(KeyError, match="ball3"):
        world.add_force((1, 0, 0), "ball9")
    with pytest.raises(IndexError):
        world.add_force((1, 0, 0), [0, 12])


def test_gravity_of_time():
    world = graintrain.World(step=1e-3)
    world.add_body(Shape.sphere(0.1))
    world.set_gravity_of_time((Function.sinusoidal(2.0, 1.0), 0.0, 0.0))
    world.run(0.5)
    assert world.velocities[0, 0] == pytest.approx(2.0 / np.pi, rel=1e-9)


def test_many_sizes():
    rng = np.random.default_rng(1)
    world = graintrain.World(step=1e-3)
    radii = rng.choice([0.01, 0.02], 50)
    world.add_plane()
    indices = world.add_spheres(rng.uniform(0, 3, (50, 3)) + [0, 0, 1], radii, velocities=np.ones((50, 3)))
    assert indices == range(1, 51)
    np.testing.assert_array_equal(world.radii[1:], radii)
    with pytest.raises(ValueError, match=r"radii has the shape \(3,\), expected \(2,\)"):
        world.add_spheres([(0, 0, 5), (0, 0, 6)], [1, 2, 3])
    with pytest.raises(graintrain.ModelError, match="radius"):
        world.add_spheres([(0, 0, 5), (0, 0, 6)], [1.0, -1.0])
    with pytest.raises(graintrain.ModelError, match="coordinate"):
        world.add_bodies(Shape.sphere(0.1), [(0, 0, 5), (0, 0, np.nan)])
    assert len(world) == 51, "all or none are added"
    assert len(world.add_bodies(Shape.sphere(0.1), np.zeros((0, 3)))) == 0
