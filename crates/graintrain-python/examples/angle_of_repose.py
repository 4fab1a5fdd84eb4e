"""Calibrate the coefficient of friction: which mu gives the angle of repose of an experiment? A tilted box is filled, the grains flow until
they rest, and their surface is held against the horizontal."""

import os

import numpy as np

import graintrain

SMALL = bool(os.environ.get("GRAINTRAIN_SMALL"))
measured, tilt = 15.0, np.radians(40.0)  # degrees in the experiment; of the box
radius, length, width = 0.01, 0.4, 0.1
walls = {"left": [-1, 0, 0], "right": [1, 0, 0], "front": [0, -1, 0], "back": [0, 1, 0]}
scene = {
    "parameters": {"mu": 0.3},
    "gravity": [9.81 * np.sin(tilt), 0.0, -9.81 * np.cos(tilt)],  # in the axes of the box
    "time": {"step": "2 ms", "end": "0.4 s" if SMALL else "2 s"},
    "material": {"stone": {"density": 2500, "friction": "mu"}},
    "body": {"floor": {"shape": {"plane": {}}}}
    | {
        name: {"shape": {"plane": {"normal": [-x for x in out]}}, "position": [0.5 * length * out[0], 0.5 * width * out[1], 0]}
        for name, out in walls.items()
    },
    "packing": {
        "grains": {
            "radius": {"uniform": {"min": 0.8 * radius, "max": radius}},
            "lattice": {"counts": [17, 4, 7], "pitch": 2.3 * radius, "jitter": 0.1 * radius, "origin": [-0.196, -0.045, 0.003]},
        }
    },
}


def repose(world: graintrain.World) -> dict[str, float]:
    """The angle of the surface against the horizontal, from the highest grains of slices across the box."""
    x, _, z = world.positions[world.free].T
    edges = np.linspace(-0.4 * length, 0.5 * length, 9)
    top = np.array([np.sort(z[(x >= a) & (x < b)])[-3:].mean() if ((x >= a) & (x < b)).sum() > 2 else np.nan for a, b in zip(edges, edges[1:])])
    there = top > 3 * radius
    slope = np.polyfit(0.5 * (edges[1:] + edges[:-1])[there], top[there], 1)[0]
    return {"angle": float(np.degrees(tilt - np.arctan(slope))), "energy": world.kinetic_energy}


values = [0.1, 0.5] if SMALL else [0.05, 0.1, 0.2, 0.3, 0.5, 0.8]
table = graintrain.sweep(scene, {"mu": values}, repose)
print(table)
angles = np.maximum.accumulate(np.array([row["angle"] for row in table.to_dict("records")]))
print(f"{measured} degrees need mu = {np.interp(measured, angles, values):.2f}")
if not SMALL:
    assert angles[0] < measured < angles[-1]
