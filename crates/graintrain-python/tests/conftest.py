"""What several tests use."""

from __future__ import annotations

import signal

import numpy as np
import pytest

import graintrain

# Where the tests run in the background of a shell that ignores Ctrl-C for them, Python would ignore it too.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def drop() -> graintrain.World:
    """27 balls above the ground, with names and radii of their own."""
    return ball_pile(3)


def ball_pile(n: int, radius: float = 0.01, **settings: object) -> graintrain.World:
    """n^3 balls in a loose lattice above a plane."""
    world = graintrain.World(**{"step": 2e-3, "envelope": 0.003, **settings})
    world.add_plane(name="ground")
    lattice = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = 2.2 * radius * lattice + [0.0, 0.0, 2.0 * radius]
    places[:, 0] += 0.1 * radius * lattice[:, 2]
    world.add_bodies(graintrain.Shape.sphere(radius), places)
    return world
