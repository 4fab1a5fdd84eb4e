"""A world in the Rerun viewer (rerun.io) while it runs: `pip install graintrain[rerun]`.

>>> import rerun, graintrain
>>> from graintrain.rerun import Log
>>> rerun.init("pile", spawn=True)                                      # doctest: +SKIP
>>> world = graintrain.World.from_scene("excavator")
>>> world.run(2.0, callback=Log(world), every=10)                       # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graintrain._graintrain import World

#: Colours of grains at rest and at the fastest speed so far; of tools; of walls.
_SLOW, _FAST, _TOOL, _WALL = (68, 1, 84), (253, 231, 37), (115, 130, 150), (205, 207, 212, 60)


class Log:
    """Logs a world to Rerun each time it is called, at the world's time: balls with their speeds, the other bodies' surfaces, contact
    forces, and the curves of kinetic energy and contacts. `entity` is the path below which all stands, `recording` a
    `rerun.RecordingStream` (by default the one of `rerun.init`).

    Bodies that come or go are logged anew. Cost: a copy of the positions per call.
    """

    def __init__(self, world: World, entity: str = "world", *, recording: Any = None) -> None:
        import rerun

        self._rerun, self._entity, self._recording = rerun, entity, recording
        self._count, self._fastest = -1, 1e-12
        self._surfaces: list[np.ndarray] = []
        self(world)

    def _log(self, path: str, *what: Any, static: bool = False) -> None:
        self._rerun.log(f"{self._entity}/{path}", *what, static=static, recording=self._recording)

    def _begin(self, world: World) -> None:
        """What does not change as long as the bodies stay: triangles, and which bodies are balls."""
        self._log("surfaces", self._rerun.Clear(recursive=True))
        surfaces = world.surfaces()
        self._count, self._surfaces = len(world.masses), [bodies for bodies, _, _ in surfaces]
        in_surfaces = np.concatenate([*self._surfaces, np.empty(0, np.uintp)])
        self._balls = np.setdiff1d(np.flatnonzero(world.free), in_surfaces)
        for number, (_, triangles, kind) in enumerate(surfaces):
            color = {"grain": _SLOW, "tool": _TOOL}.get(kind, _WALL)
            points = triangles.reshape(-1, 3)
            mesh = self._rerun.Mesh3D(
                vertex_positions=points, triangle_indices=np.arange(len(points)).reshape(-1, 3), albedo_factor=color
            )
            self._log(f"surfaces/{number}", mesh)

    def __call__(self, world: World) -> None:
        rerun = self._rerun
        rerun.set_time("time", duration=world.time, recording=self._recording)
        if self._count != len(world.masses):
            self._begin(world)
        positions, speeds = np.array(world.positions), np.linalg.norm(world.velocities, axis=1)
        self._fastest = max(self._fastest, float(speeds[world.free].max(initial=0.0)))
        part = np.clip(speeds[self._balls] / self._fastest, 0.0, 1.0)[:, None]
        colors = ((1 - part) * _SLOW + part * _FAST).astype(np.uint8)
        self._log("balls", rerun.Points3D(positions[self._balls], radii=world.radii[self._balls], colors=colors))
        turns = np.array(world.quaternions)
        for number, bodies in enumerate(self._surfaces):
            poses = rerun.InstancePoses3D(translations=positions[bodies], quaternions=turns[bodies])
            self._log(f"surfaces/{number}", poses)
        contacts = world.contacts
        self._log("contacts", rerun.Arrows3D(origins=contacts.points, vectors=self._arrows(world)))
        self._log("kinetic_energy", rerun.Scalars(world.kinetic_energy))
        self._log("contacts_count", rerun.Scalars(len(contacts)))

    def _arrows(self, world: World) -> np.ndarray:
        """Normals, as long as a grain's radius where the force is largest."""
        forces, normals = np.array(world.contacts.impulses)[:, 0], np.array(world.contacts.normals)
        largest = forces.max(initial=0.0)
        reach = float(np.median(world.radii[self._balls])) if len(self._balls) else 1.0
        return normals * (reach * forces / largest if largest > 0.0 else 0.0 * forces)[:, None]
