"""Many worlds side by side."""

from __future__ import annotations

import _thread
import threading

import numpy as np
import pytest

import graintrain
from conftest import ball_pile


def pile(seed: int) -> graintrain.World:
    world = ball_pile(2)
    world.velocities[1:] += np.random.default_rng(seed).normal(0, 0.1, (8, 3))
    return world


def test_a_batch_has_the_bits_of_each_alone():
    together, alone = [pile(seed) for seed in range(12)], [pile(seed) for seed in range(12)]
    batch = graintrain.Batch(together)
    reports = batch.run(0.2)
    for world in alone:
        world.run(0.2)
    assert [world.state_hash for world in together] == [world.state_hash for world in alone]
    assert len({world.state_hash for world in alone}) == 12
    assert len(reports) == len(batch) == 12 and all(report.solve.converged for report in reports)
    batch.run(steps=3)
    assert {world.steps for world in batch.worlds} == {103}


def test_worlds_of_their_own_ends_and_steps():
    first = graintrain.World.from_scene("stack", set={"time.end": "10 ms"})
    second = ball_pile(2, step=1e-3)
    graintrain.Batch([first, second]).run("20 ms")
    assert first.time == pytest.approx(0.02) and second.steps == 20
    assert graintrain.Batch([]).run(1.0) == []


def test_the_error_of_one_names_its_place_and_leaves_the_others():
    worlds = [pile(seed) for seed in range(3)]
    worlds[1].forces[3] = np.inf
    with pytest.raises(graintrain.StepError, match="body 3") as caught:
        graintrain.Batch(worlds).run(0.1)
    if hasattr(caught.value, "__notes__"):
        assert caught.value.__notes__ == ["in worlds[1]"]
    assert [world.steps for world in worlds] == [50, 0, 50]
    with pytest.raises(ValueError, match="twice"):
        graintrain.Batch([worlds[0], worlds[0]])


def test_ctrl_c_leaves_whole_steps():
    worlds = [ball_pile(4) for _ in range(4)]
    threading.Timer(0.3, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        graintrain.Batch(worlds).run(1e4)
    for world in worlds:
        other = world.copy()
        world.run(steps=2)
        other.run(steps=2)
        assert world.state_hash == other.state_hash


def test_a_sweep_is_a_table():
    scene = {
        "parameters": {"mu": 0.3},
        "gravity": [4.905, 0.0, -8.4957],
        "time": {"step": "1 ms", "end": "0.1 s"},
        "contact": {"envelope": "1 mm"},
        "material": {"wood": {"density": 600, "friction": "mu"}},
        "body": {
            "ground": {"shape": {"plane": {}}},
            "block": {"shape": {"box": {"size": [0.2, 0.2, 0.1]}}, "position": [0, 0, 0.05]},
        },
    }
    table = graintrain.sweep(
        scene,
        {"mu": [0.1, 0.3, 0.5], "time.step": ["1 ms", "2 ms"]},
        lambda world: {"speed": world.velocities[world.index("block"), 0]},
        side_by_side=4,
    )
    pandas = pytest.importorskip("pandas")
    assert isinstance(table, pandas.DataFrame) and list(table.columns) == ["mu", "time.step", "speed"] and len(table) == 6
    for _, row in table.iterrows():
        assert row["speed"] == pytest.approx(0.1 * (4.905 - row["mu"] * 8.4957), rel=1e-2)
