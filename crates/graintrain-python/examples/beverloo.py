"""Beverloo's hopper: the rate at which balls leave through a hole does not depend on the height above it, but on (D - k d)^5/2.

Balls of diameter d run out of a flat bottom through holes of four diameters D. The line W^2/5 over D gives the k and the C of
W = C rho_bulk sqrt(g) (D - k d)^5/2; measurements with many grains have k from 1 to 2 and C from 0.55 to 0.65.
"""

import os

import numpy as np

import graintrain
from graintrain import Function, Motion, Shape

SMALL = bool(os.environ.get("GRAINTRAIN_SMALL"))
radius, density = 0.005, 2500.0
d, side = 2 * radius, 0.1
holes, layers = ([6 * d, 8 * d], 6) if SMALL else ([4.5 * d, 5.5 * d, 6.5 * d, 7.5 * d], 10)


def bottom(hole: float, count: int = 32) -> Shape:
    """The flat bottom z = 0 with a round hole: a ring of triangles out to where the walls stand."""
    angle = 2 * np.pi * np.arange(count) / count
    around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    k, after = np.arange(count), (np.arange(count) + 1) % count
    triangles = np.concatenate([np.stack([k, k + count, after], 1), np.stack([after, k + count, after + count], 1)])
    return Shape.mesh(np.concatenate([0.5 * hole * around, side * around]), triangles)


def hopper(hole: float) -> graintrain.World:
    """A hopper whose hole is shut by a plate until 0.3 s."""
    world = graintrain.World(step=1e-3, envelope=0.3 * radius, tolerance=1e-3)
    world.add_material("glass", density=density, friction=0.5)
    world.add_body(bottom(hole), material="glass", motion=Motion.fixed())
    world.add_plane((0, 0, -1e-3), material="glass", motion=Motion.translating((0, 0, -1), Function.delayed(0.3, 5.0)))
    for normal in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]:
        world.add_plane(-0.5 * side * np.array(normal), normal, material="glass")
    x, y, z = np.meshgrid(*[np.arange(9) - 4.0] * 2, np.arange(layers), indexing="ij")
    rng = np.random.default_rng(1)
    places = 1.1 * d * np.stack([x, y, z], axis=-1).reshape(-1, 3) + [0, 0, 1.2 * radius]
    sizes = radius * rng.uniform(0.9, 1.0, len(places))
    world.add_spheres(places + 0.05 * radius * rng.uniform(-1, 1, places.shape), sizes, material="glass")
    return world


worlds = [hopper(hole) for hole in holes]
batch, times, outside = graintrain.Batch(worlds), [], []
batch.run(0.3)
total = worlds[0].masses.sum()
bulk = total / (side**2 * np.percentile(worlds[0].positions[worlds[0].free, 2], 99))
for _ in range(20 if SMALL else 45):
    batch.run(steps=20)
    times.append(worlds[0].time)
    outside.append([world.masses[world.positions[:, 2] < -d].sum() for world in worlds])
times, outside = np.array(times), np.array(outside)

rates = []
for mass in outside.T:
    flows = (mass > 0.1 * total) & (mass < 0.6 * total)
    rates.append(np.polyfit(times[flows], mass[flows], 1)[0] if flows.sum() > 2 else 0.0)
mean = 0.95 * d
slope, intercept = np.polyfit(holes, np.power(rates, 0.4), 1)
k, c = -intercept / slope / mean, slope**2.5 / (bulk * 9.81**0.5)
for hole, rate in zip(holes, rates):
    print(f"D = {hole / mean:4.1f} d: {rate:.3f} kg/s, the line {(slope * hole + intercept)**2.5:.3f} kg/s")
print(f"k = {k:.2f}, C = {c:.2f}, with the bulk density {bulk:.0f} kg/m^3")
if not SMALL:
    assert 0.5 < k < 3.0 and 0.4 < c < 0.9
