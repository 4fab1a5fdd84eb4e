"""Worlds: arrays over their memory, steps, checkpoints, errors."""

from __future__ import annotations

import _thread
import copy
import gc
import pickle
import threading
import time

import numpy as np
import pytest

import graintrain
from conftest import ball_pile

ARRAYS = ["positions", "quaternions", "velocities", "angular_velocities", "forces", "torques", "masses", "inertias"]


def test_what_is_written_into_an_array_is_the_state(drop):
    drop.positions[5] = [0.1, 0.2, 0.3]
    assert drop.positions[5].tolist() == [0.1, 0.2, 0.3]
    before = drop.state_hash
    drop.velocities[5, 0] = 1.0
    assert drop.state_hash != before
    drop.velocities[5, 0] = 0.0
    assert drop.state_hash == before
    velocities = drop.velocities
    velocities += [0.5, 0.0, 0.0]
    drop.step()
    # The plane is fixed whatever is written; the body that was carried away from the others flies freely.
    assert drop.velocities[0].tolist() == [0.0, 0.0, 0.0]
    assert drop.velocities[5].tolist() == [0.5, 0.0, pytest.approx(-9.81 * 2e-3, rel=1e-14)]
    assert np.shares_memory(velocities, drop.velocities)
    drop.velocities *= 2.0
    assert velocities[5, 0] == 1.0
    drop.velocities = np.zeros((28, 3))
    assert not velocities.any()


def test_views_stay_where_they_are_while_the_world_steps():
    world = graintrain.World.from_scene("sedimentation", set={"n": 2})
    # Loads change forces within a step, impacts and missed contacts take steps back: no list may be replaced.
    world.add_drag(linear=1e-4)
    views = {name: getattr(world, name) for name in ARRAYS}
    places = {name: view.__array_interface__["data"][0] for name, view in views.items()}
    world.velocities[:, 2] = -20.0
    world.run(steps=60)
    for name, view in views.items():
        now = getattr(world, name)
        assert now.__array_interface__["data"][0] == places[name], name
        np.testing.assert_array_equal(view, now)
    assert abs(views["velocities"]).max() > 0.0


def test_arrays_keep_the_world_alive():
    positions = ball_pile(2).positions
    copied = positions.copy()
    gc.collect()
    filler = [np.ones(positions.size) for _ in range(100)]
    np.testing.assert_array_equal(positions, copied)
    assert filler


def test_the_number_of_bodies_cannot_change_under_an_array(drop):
    ball = graintrain.Shape.sphere(0.01)
    part = drop.positions[3:5, 1]
    for change in [
        lambda: drop.add_body(ball, (1, 1, 1)),
        lambda: drop.add_bodies(ball, [(1, 1, 1)]),
        lambda: drop.add_spheres([(1, 1, 1)], 0.01),
        lambda: drop.add_plane((0, 0, -1)),
        lambda: drop.remove_bodies([False] * 27 + [True]),
    ]:
        with pytest.raises(BufferError, match="copies"):
            change()
    assert len(drop) == 28 and part.shape == (2,)
    del part
    assert drop.add_body(ball, (1, 1, 1)) == 28
    drop.remove_bodies([False] * 28 + [True])
    assert len(drop) == 28


def test_masses_and_contacts_are_read_only(drop):
    with pytest.raises(ValueError, match="read-only"):
        drop.masses[1] = 2.0
    drop.run(0.2)
    with pytest.raises(ValueError, match="read-only"):
        drop.contacts.points[0] = 0.0
    assert drop.masses[1] == pytest.approx(1000 * 4 / 3 * np.pi * 0.01**3)
    assert drop.radii[1] == 0.01 and np.isinf(drop.radii[0])
    assert drop.free.tolist() == [False] + [True] * 27


def test_contacts_are_a_snapshot(drop):
    drop.run(0.4)
    contacts = drop.contacts
    assert len(contacts) > 27
    points, gaps = contacts.points.copy(), contacts.gaps.copy()
    pairs = contacts.bodies
    assert pairs.shape == (len(contacts), 2) and pairs.dtype == np.uint32
    np.testing.assert_allclose(np.linalg.norm(contacts.normals, axis=1), 1.0)
    # Between balls the gap is the distance of centres less the radii, before the step that closed it.
    balls = (pairs > 0).all(axis=1)
    assert balls.any() and (contacts.identities != 0).all() and (contacts.friction == 0.25).all()
    # The floor carries the weight.
    pressed = contacts.impulses[~balls, 2].sum() / drop.dt
    assert abs(pressed) == pytest.approx(9.81 * drop.masses.sum(), rel=0.05)
    force, torque = drop.wrench("ground")
    assert force[2] == pytest.approx(-abs(pressed), rel=1e-6) and len(torque) == 3
    drop.run(steps=20)
    np.testing.assert_array_equal(points, contacts.points)
    np.testing.assert_array_equal(gaps, contacts.gaps)
    assert drop.contacts is drop.contacts and drop.contacts is not contacts


def test_external_forces_are_those_of_newton():
    world = graintrain.World(gravity=(0, 0, 0), step=1e-3)
    body = world.add_body(graintrain.Shape.sphere(0.1))
    mass = world.masses[body]
    world.forces[body] = [2.0, 0.0, 0.0]
    world.torques[body] = [0.0, 0.0, 0.3]
    world.step(100)
    assert world.velocities[body, 0] == pytest.approx(0.1 * 2.0 / mass, rel=1e-12)
    assert world.angular_velocities[body, 2] == pytest.approx(0.1 * 0.3 / (0.4 * mass * 0.01), rel=1e-12)
    world.clear_forces()
    world.add_force_at(body, (0, 1.0, 0), world.positions[body] + [0.05, 0, 0])
    assert world.torques[body, 2] == pytest.approx(0.05)
    assert world.kinetic_energy > 0 and world.potential_energy == 0.0


def test_scenes_from_files_text_and_dicts_are_the_same(tmp_path):
    scene = {
        "parameters": {"r": "1 cm"},
        "time": {"step": "1 ms", "end": "0.1 s"},
        "material": {"glass": {"density": 2500, "friction": np.float64(0.3)}},
        "body": {
            "ground": {"shape": {"plane": {}}},
            "ball": {"shape": {"sphere": {"radius": "r"}}, "position": np.array([0.0, 0.0, 0.03])},
        },
    }
    text = """
        parameters.r = "1 cm"
        time = { step = "1 ms", end = "0.1 s" }
        material.glass = { density = 2500, friction = 0.3 }
        body.ground = { shape = { plane = {} } }
        body.ball = { shape = { sphere = { radius = "r" } }, position = [0, 0, 0.03] }
    """
    file = tmp_path / "ball.toml"
    file.write_text(text)
    worlds = [
        graintrain.World.from_scene(scene),
        graintrain.World.from_text(text),
        graintrain.World.from_scene(file),
        graintrain.World.from_scene(str(file), set={"time.end": "0.1 s"}),
    ]
    for world in worlds:
        report = world.run()
        assert world.time == pytest.approx(0.1) and world.end == pytest.approx(0.1)
        assert report.contacts == 1 and report.solve.converged
    assert len({world.state_hash for world in worlds}) == 1
    assert graintrain.World.from_scene(scene, set=["r=2 cm", "body.ball.position=[0, 0, 0.1]"]).radii[1] == 0.02


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: graintrain.World.from_scene("sedimentaton"), graintrain.SceneError, "sedimentation"),
        (lambda: graintrain.World.from_text("tme.step = 1"), graintrain.SceneError, "text:1:1.*time"),
        (lambda: graintrain.World.from_scene({"time": {"step": object()}}), TypeError, "time.step"),
        (lambda: graintrain.World.from_scene({1: 2}), TypeError, "keys are texts"),
        (lambda: graintrain.World.from_scene(3), TypeError, "path"),
        (lambda: graintrain.World.from_scene("sedimentation", set={"m": 3}), graintrain.SceneError, "m"),
        (lambda: graintrain.World.from_scene("sedimentation", set="n=3"), TypeError, "list"),
        (lambda: graintrain.World(step=-1.0), graintrain.ModelError, "time step"),
        (lambda: graintrain.World(stp=1.0), TypeError, "known: step"),
        (lambda: graintrain.World(solver="fastest"), graintrain.ProblemError, "known solvers"),
        (lambda: graintrain.World(gravity=(1, 2)), ValueError, r"gravity has the shape \(2,\), expected \(3,\)"),
        (lambda: graintrain.World(gravity="down"), TypeError, "gravity"),
        (lambda: graintrain.World.from_bytes(b"GRAINCKP"), graintrain.CheckpointError, "cut short"),
        (lambda: graintrain.World.from_bytes(b"nothing"), graintrain.CheckpointError, "not a checkpoint"),
        (lambda: graintrain.World().run(), ValueError, "until"),
    ],
)
def test_messages_name_what_is_wrong(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_arrays_with_nonsense_are_refused_and_the_state_kept(drop):
    drop.velocities[3, 1] = np.nan
    with pytest.raises(graintrain.StepError, match="body 3 is NaN"):
        drop.step()
    drop.velocities[3, 1] = 0.0
    drop.quaternions[4] = [0, 0, 0, 2]
    with pytest.raises(ValueError, match=r"quaternions\[4\].*length.*2"):
        drop.run(0.1)
    drop.quaternions[4] = [0, 0, 1, 0]
    drop.step()
    with pytest.raises(ValueError):
        drop.positions = np.zeros((3, 3))
    with pytest.raises(KeyError, match="ground"):
        drop.wrench("floor")
    with pytest.raises(IndexError, match="28"):
        drop.wrench(28)


def test_checkpoints_go_on_with_the_same_bits(drop):
    drop.run(0.1)
    others = [
        graintrain.World.from_bytes(drop.to_bytes()),
        drop.copy(),
        copy.deepcopy(drop),
        pickle.loads(pickle.dumps(drop)),
    ]
    drop.run(0.2)
    for other in others:
        assert other.state_hash != drop.state_hash and other.steps == 50
        other.run(0.2)
        assert other.state_hash == drop.state_hash


def test_runs_call_back_and_end_where_asked(drop):
    seen = []
    drop.run(0.1, callback=lambda world: seen.append((world.steps, world.positions[1, 2])), every=20)
    assert [steps for steps, _ in seen] == [20, 40, 50]
    assert seen[0][1] > seen[1][1]
    assert drop.run("0.2 s", callback=lambda world: world.steps == 60).contacts >= 0
    assert drop.steps == 60
    drop.run(steps=5)
    drop.run(0.01)  # In the past: nothing to do.
    assert drop.steps == 65 and drop.last_report is not None

    def fails(_):
        raise LookupError("from the callback")

    with pytest.raises(LookupError, match="from the callback"):
        drop.run(steps=1, callback=fails)
    assert drop.steps == 66


def test_a_callback_may_steer(drop):
    def hold(world):
        world.velocities[1:] = 0.0

    height = drop.positions[1, 2]
    drop.run(steps=3, callback=hold)
    assert drop.positions[1, 2] == pytest.approx(height - 3 * 0.5 * 9.81 * 2e-3**2, rel=1e-9)


def test_the_interpreter_runs_meanwhile():
    world = ball_pile(6)
    worker = threading.Thread(target=world.run, args=(0.5,))
    worker.start()
    count = 0
    while worker.is_alive():
        count += 1
        time.sleep(1e-3)
    assert count > 20, "other threads stand still during a run"
    assert world.time == pytest.approx(0.5)


def test_ctrl_c_leaves_a_whole_step():
    world = ball_pile(6)
    threading.Timer(0.3, _thread.interrupt_main).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        world.run(1e4)
    assert time.monotonic() - start < 20
    assert world.steps > 0
    other = graintrain.World.from_bytes(world.to_bytes())
    world.run(steps=5)
    other.run(steps=5)
    assert other.state_hash == world.state_hash


def test_settings_can_be_changed(drop):
    assert drop.settings["solver"] == "auto" and drop.dt == 2e-3
    positions = drop.positions
    drop.configure(step=1e-3, solver="ipm", tolerance=1e-6, friction="coulomb", strict_max=True)
    drop.run(0.1)
    assert drop.steps == 100 and drop.last_report.solve.solver.startswith("ipm")
    assert positions[1, 2] == drop.positions[1, 2]
    with pytest.raises(graintrain.ModelError):
        drop.configure(step=0.0)
    assert drop.dt == 1e-3 and drop.totals["unconverged_steps"] == 0


def test_strict_runs_raise():
    world = ball_pile(3, tolerance=1e-14, max_iterations=1, solver="pgs")
    with pytest.raises(graintrain.NotConverged, match="residual"):
        world.run(1.0, strict=True)
    assert isinstance(graintrain.NotConverged("x"), graintrain.StepError)


def test_a_step_report_has_the_columns_of_steps_csv(drop):
    report = drop.step()
    columns = report.to_dict()
    assert report.contacts == columns["contacts"] > 0
    assert report.status == "converged" and isinstance(report.cone_excess, float)
    assert report.rank_matrix is None
    assert set(columns) <= set(dir(report)) and "solve" in dir(report)
    with pytest.raises(AttributeError, match="dir"):
        report.penetration
