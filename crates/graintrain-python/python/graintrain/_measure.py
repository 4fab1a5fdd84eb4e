"""Numbers of a sample from the contacts of the last step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graintrain._graintrain import World


def stress(world: World, low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """Mean stress (3, 3), Pa, compression positive, of the free bodies whose centres lie in the box from `low` to `high`, m.

    sigma = -1/V sum over these bodies b and their contacts c of (x_c - x_b) f_c^T, with the forces f of the last step, averaged over it. In
    equilibrium that is the mean of the stress over the bodies (J. Christoffersen, M. M. Mehrabadi, S. Nemat-Nasser, J. Appl. Mech. 48, 1981), V the volume
    of the box; a body is counted wholly where its centre is inside.
    """
    corners = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    for name, corner in zip(["low", "high"], corners):
        if corner.shape != (3,):
            raise ValueError(f"{name} has the shape {corner.shape}, expected (3,)")
    if not (corners[1] > corners[0]).all():
        raise ValueError(f"the box from {corners[0]} to {corners[1]} is empty")
    centers = world.positions
    inside = ((centers >= corners[0]) & (centers <= corners[1])).all(axis=1) & world.free
    contacts = world.contacts
    total = np.zeros((3, 3))
    for side, sign in enumerate([1.0, -1.0]):
        body: Any = contacts.bodies[:, side]
        counted = inside[body]
        arms = contacts.points[counted] - centers[body[counted]]
        total += sign * arms.T @ contacts.impulses[counted] / world.dt
    return -total / float(np.prod(corners[1] - corners[0]))
