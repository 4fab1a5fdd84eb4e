"""Derivatives of a step. Ten more scenes are compared in crates/graintrain/tests/physics/gradients.rs."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain
from conftest import ball_pile
from graintrain import Shape


def scenes() -> dict[str, graintrain.World]:
    pile = ball_pile(2)
    pile.configure(friction="relaxed")
    pile.run(0.1)
    slide = graintrain.World(step=1e-2, envelope=1e-3, friction="relaxed")
    slide.add_plane()
    slide.add_body(Shape.box((0.1, 0.08, 0.05)), (0, 0, 0.05), velocity=(1.0, 0.3, 0), angular_velocity=(0, 0, 0.5))
    rest = graintrain.World(gravity=(1.0, 0.5, -9.0), step=1e-2, envelope=1e-3, friction="relaxed")
    rest.add_plane()
    rest.add_body(Shape.box((0.1, 0.08, 0.05)), (0, 0, 0.05))
    rest.add_body(Shape.sphere(0.1), (1, 0, 0.1), velocity=(0, 0, 1.0))
    return {"a settling pile": pile, "a box that slides": slide, "a box at rest, a ball that parts": rest}


def loss(world: graintrain.World, linear: np.ndarray, spin: np.ndarray) -> float:
    world.configure(solver="ipm", tolerance=1e-11, strict_max=True)
    world.step()
    return float((world.velocities * linear).sum() + (world.angular_velocities * spin).sum())


@pytest.mark.parametrize("name", ["a box that slides", "a box at rest, a ball that parts", "a settling pile"])
def test_products_are_those_of_central_differences(name):
    world = scenes()[name]
    rng = np.random.default_rng(5)
    linear, spin = rng.normal(size=(2, len(world), 3))
    before = world.state_hash
    gradient = world.gradient()
    assert world.state_hash == before, "the step is made on a copy"
    pulled = gradient.vjp(linear, spin)
    assert set(gradient.states) <= {"apart", "sticking", "sliding"}
    assert gradient.bodies.shape == (len(gradient.states), 2) and pulled["friction"].shape == (len(gradient.states),)
    mass = world.masses.max()
    scale = {"velocities": 1.0, "angular_velocities": 1.0, "forces": 9.81 * mass, "torques": 0.981 * mass}
    for array, size in scale.items():
        for trial in range(3):
            direction = rng.normal(size=(len(world), 3))
            direction[~world.free] = 0.0
            h = 1e-5 * size

            def at(x):
                changed = world.copy()
                setattr(changed, array, getattr(world, array) + x * direction)
                return loss(changed, linear, spin)

            expected = (at(h) - at(-h)) / (2 * h) * size
            got = float((pulled[array] * direction).sum()) * size
            assert got == pytest.approx(expected, rel=1e-4, abs=1e-4), (array, trial)
    pair = ("default", "default")
    if name != "a settling pile":

        def with_friction(mu):
            changed = world.copy()
            changed.set_pair(*pair, mu)
            return loss(changed, linear, spin)

        expected = (with_friction(0.25 + 1e-6) - with_friction(0.25 - 1e-6)) / 2e-6
        assert pulled["pairs"][pair] == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_a_slide_by_hand():
    world = graintrain.World(step=1e-2, envelope=1e-3, friction="relaxed")
    world.add_plane()
    body = world.add_body(Shape.sphere(0.1), (0, 0, 0.1), velocity=(3.0, 0, 0))
    along_x = np.zeros((2, 3))
    along_x[body, 0] = 1.0
    pulled = world.gradient().vjp(along_x)
    # v_x+ = v_x - mu v_n with the normal velocity g dt that the contact takes, and its relaxed slip mu |u_t|.
    assert pulled["velocities"][body, 0] == pytest.approx(1.0 - 0.25 * 0.25, rel=0.1)
    assert pulled["pairs"]["default", "default"] < 0.0
    assert pulled["forces"][body, 0] == pytest.approx(pulled["velocities"][body, 0] * 1e-2 / world.masses[body])


def test_kinks_are_reported():
    world = graintrain.World(step=1e-2, envelope=1e-3, friction="relaxed")
    world.add_plane()
    body = world.add_body(Shape.sphere(0.1), (0, 0, 0.1), name="ball")
    world.forces[body, 2] = 9.81 * world.masses[body]
    with pytest.raises(graintrain.NotDifferentiable, match="touches without pressing.*'ball'"):
        world.gradient()
    world.forces[body, 2] = 0.0
    gradient = world.gradient()
    with pytest.raises(ValueError, match=r"velocities has the shape \(3, 3\), expected \(2, 3\)"):
        gradient.vjp(np.zeros((3, 3)))
    world.configure(friction="coulomb")
    with pytest.raises(graintrain.NotDifferentiable, match="exact"):
        world.gradient()
