"""Janssen's silo: the ground carries less than the weight, and after a while no more at all; walls carry the rest.

Square silos are filled to five heights, their ground goes down slowly, so that friction is mobilised at the walls, and the force on it is held
against Janssen's M_ground = M_full (1 - exp(-M / M_full)) with one number fitted, M_full = rho side^3 / (4 mu K).
"""

import os

import numpy as np

import graintrain
from graintrain import Motion, Shape

SMALL = bool(os.environ.get("GRAINTRAIN_SMALL"))
radius, mu = 0.01, 0.5
side = 12 * radius
layers = [4, 8] if SMALL else [6, 12, 18, 27, 36]


def silo(count: int) -> graintrain.World:
    """A silo with so many layers of 5 x 5 balls, ready to settle."""
    world = graintrain.World(step=1e-3, envelope=0.3 * radius, tolerance=1e-3)
    world.add_material("glass", density=2500, friction=mu)
    down = Motion.translating((0, 0, -1), graintrain.Function.delayed(0.5, 0.02))
    world.add_plane((0, 0, 0), material="glass", motion=down, name="ground")
    for normal in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]:
        world.add_plane(-0.5 * side * np.array(normal), normal, material="glass")
    x, y, z = np.meshgrid(np.arange(5) - 2.0, np.arange(5) - 2.0, np.arange(count), indexing="ij")
    rng = np.random.default_rng(count)
    places = np.stack([x, y, z], axis=-1).reshape(-1, 3) * 2.3 * radius + [0, 0, 1.1 * radius]
    sizes = radius * rng.uniform(0.85, 1.0, len(places))
    world.add_spheres(places + rng.uniform(-0.05, 0.05, places.shape) * radius, sizes, material="glass")
    return world


worlds = [silo(count) for count in layers]
batch = graintrain.Batch(worlds)
batch.run(0.6)
samples = []
for _ in range(10 if SMALL else 40):
    batch.run(steps=10)
    samples.append([-world.wrench("ground")[0][2] / 9.81 for world in worlds])
poured = np.array([world.masses.sum() for world in worlds])
felt = np.mean(samples, axis=0)

candidates = np.geomspace(0.1 * felt.max(), 100 * poured.max(), 20_000)[:, None]
errors = ((candidates * (1 - np.exp(-poured / candidates)) - felt) ** 2).sum(axis=1)
full = float(candidates[errors.argmin(), 0])
janssen = full * (1 - np.exp(-poured / full))
for line in zip(poured, felt, janssen):
    print("poured {:6.3f} kg, the ground feels {:6.3f} kg, Janssen {:6.3f} kg".format(*line))
print(f"M_full = {full:.3f} kg, so K = {0.6 * 2500 * side**3 / (4 * mu * full):.2f}; worst difference {abs(janssen - felt).max() / full:.1%} of it")
if not SMALL:
    assert felt[-1] < 0.8 * poured[-1] and abs(janssen - felt).max() < 0.15 * full
