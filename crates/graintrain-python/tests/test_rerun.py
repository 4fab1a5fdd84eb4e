"""Worlds in Rerun, and the surfaces that it shows."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain


def excavator():
    return graintrain.World.from_scene("excavator", set={"rows": 6, "columns": 3, "layers": 2})


def test_surfaces_are_those_of_the_shapes():
    world = graintrain.World(step=1e-3)
    world.add_material("stone", density=2000)
    world.add_plane(material="stone")
    box = world.add_bodies(graintrain.Shape.box((1, 2, 3)), [[0, 0, 5], [4, 0, 5]], material="stone")
    world.add_spheres([[9, 0, 1]], [0.5], material="stone")
    surfaces = {kind: (bodies, triangles) for bodies, triangles, kind in world.surfaces()}
    bodies, triangles = surfaces["grain"]
    assert list(bodies) == list(range(box.start, box.stop))
    assert triangles.shape == (12, 3, 3) and triangles.dtype == np.float32
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(8 * 6.0)
    assert set(surfaces) == {"grain", "wall"} and list(surfaces["wall"][0]) == [0]


def test_a_run_is_logged(tmp_path):
    rerun = pytest.importorskip("rerun")
    from graintrain.rerun import Log

    world = excavator()
    recording = rerun.RecordingStream("excavator")
    recording.save(str(tmp_path / "run.rrd"))
    world.run(steps=20, callback=Log(world, recording=recording), every=5)
    recording.flush()
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
