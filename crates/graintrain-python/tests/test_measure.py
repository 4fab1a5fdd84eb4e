"""Numbers of a sample against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain
from graintrain import Motion, Shape


def test_the_stress_under_a_press_is_force_over_area():
    radius, count = 0.01, 4
    world = graintrain.World(gravity=(0, 0, 0), step=1e-3, envelope=1e-3, tolerance=1e-8)
    world.add_plane()
    lattice = np.stack(np.meshgrid(*[np.arange(count)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    world.add_bodies(Shape.sphere(radius), 2 * radius * lattice + radius)
    side = 2 * radius * count
    down = Motion.fixed().with_free([False, False, True, False, False, False])
    press = world.add_body(Shape.box((side, side, radius)), (side / 2, side / 2, side + radius), motion=down)
    world.forces[press, 2] = -100.0
    world.run(steps=10)
    sigma = graintrain.stress(world, (0, 0, 0), (side, side, side))
    expected = np.zeros((3, 3))
    expected[2, 2] = 100.0 / side**2
    np.testing.assert_allclose(sigma, expected, atol=1e-3 * expected[2, 2])
    half = graintrain.stress(world, (0, 0, 0), (side, side, side / 2))
    assert half[2, 2] == pytest.approx(expected[2, 2], rel=1e-3)
    with pytest.raises(ValueError, match="empty"):
        graintrain.stress(world, (0, 0, 0), (1, 1, 0))
    with pytest.raises(ValueError, match=r"low has the shape \(2,\)"):
        graintrain.stress(world, (0, 0), (1, 1, 1))


def test_a_pressed_column_by_hand():
    radius, count = 0.01, 4
    world = graintrain.World(gravity=(0, 0, 0), step=1e-3, envelope=1e-3, tolerance=1e-8)
    world.add_plane()
    column = np.stack([np.zeros(count), np.zeros(count), (2 * np.arange(count) + 1) * radius], axis=1)
    world.add_bodies(Shape.sphere(radius), column)
    top = 2 * radius * count
    down = Motion.fixed().with_free([False, False, True, False, False, False])
    press = world.add_body(Shape.box((radius, radius, radius)), (0, 0, top + radius), motion=down)
    world.forces[press, 2] = -10.0
    world.run(steps=10)
    box = (-radius, -radius, 0), (radius, radius, top)
    # The press that only one ball holds is a rattler of two, and so on down.
    assert world.coordination(*box)["rattlers"] == 4
    found = world.coordination(*box, rattlers_below=1)
    assert (found["bodies"], found["contacts"], found["rattlers"], found["mean"]) == (4, 5, 0, 2.0)
    assert found["hyperstaticity"] == 5 * 3 - 4 * 6
    np.testing.assert_allclose(world.fabric(*box), np.diag([0.0, 0.0, 1.0]), atol=1e-9)
    np.testing.assert_allclose(world.normal_forces(*box), np.full(5, 10.0), rtol=1e-5)
    assert world.porosity(*box) == pytest.approx(1 - np.pi / 6, abs=1e-4)
    with pytest.raises(ValueError, match="both low and high"):
        world.fabric(box[0])
    with pytest.raises(ValueError, match="empty"):
        world.porosity(box[1], box[0])
