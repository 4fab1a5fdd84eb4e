"""First pile: 512 balls fall into a tray; how high they lie, and what the ground carries."""

import os

import numpy as np

import graintrain

n = 4 if os.environ.get("GRAINTRAIN_SMALL") else 8
radius = 0.01
world = graintrain.World(step=2e-3, envelope=0.3 * radius)
world.add_material("glass", density=2500, friction=0.5)
world.add_plane(material="glass", name="ground")
lattice = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
places = 2.2 * radius * (lattice + 0.1 * np.random.default_rng(1).random((n**3, 3))) + [0, 0, radius]
for normal in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]:
    world.add_plane(radius * n * ((1, 1, 0) - 1.4 * np.array(normal)), normal, material="glass")
balls = world.add_bodies(graintrain.Shape.sphere(radius), places, material="glass")

# The arrays look into the world's memory: no copies, and what is written there is the state.
positions = world.positions[balls.start :]
world.run(1.5, callback=lambda w: print(f"{w.time:.1f} s: {w.kinetic_energy:9.2e} J, top at {positions[:, 2].max():.3f} m"), every=250)

weight = 9.81 * world.masses[balls.start :].sum()
carried = -world.wrench("ground")[0][2]
print(f"the ground carries {carried:.3f} N of {weight:.3f} N; {len(world.contacts)} contacts")
assert abs(carried / weight - 1) < 0.05
world.render(color="force").save("first_pile.png")
