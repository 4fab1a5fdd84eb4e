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
