"""Joints of worlds built in code."""

import graintrain
import numpy as np
import pytest
from graintrain import Shape


def test_a_pendulum_swings_with_its_period():
    world = graintrain.World(step=1e-4, tolerance=1e-9)
    bob = world.add_body(Shape.sphere(0.01), (0.01, 0, -1.0), mass=1.0, inertia=1e-9 * np.eye(3))
    world.add_joint("revolute", bob, point=(0, 0, 0), axis=(0, 1, 0), name="hinge")
    # A quarter of the period of small swings, 2 pi sqrt(l / g).
    world.step(round(0.5 * np.pi * np.sqrt(1.0 / 9.81) / 1e-4))
    hinge = world.joints[0]
    assert hinge["name"] == "hinge"
    assert abs(world.positions[bob, 0]) < 1e-5
    assert hinge["rate"] == pytest.approx(0.01 * np.sqrt(9.81), rel=1e-3)


def test_a_motor_lifts_a_weight_through_a_gear():
    world = graintrain.World(step=1e-3, tolerance=1e-9)
    weight = world.add_body(Shape.sphere(0.05), (0, 0, 0), mass=2.0, inertia=1e-3 * np.eye(3))
    pinion = world.add_body(Shape.sphere(0.05), (1, 0, 0), mass=1.0, inertia=1e-3 * np.eye(3), name="pinion")
    turn = world.add_joint("revolute", "pinion", point=(1, 0, 0), axis=(0, 1, 0), speed=2.0, limit=3.0)
    slide = world.add_joint("prismatic", weight, point=(0, 0, 0), axis=(0, 0, 1))
    world.add_joint("gear", joints=(turn, slide), ratio=0.1)
    world.step(500)
    assert world.velocities[weight, 2] == pytest.approx(0.2)
    assert world.joints[turn]["drive"] == pytest.approx(2.0 * 9.81 * 0.1)
    assert pinion == 1


def test_wrong_joints_are_reported():
    world = graintrain.World(step=1e-3)
    ball = world.add_body(Shape.sphere(0.1), (0, 0, 0))
    for wrong, error, message in [
        (lambda: world.add_joint("hinge", ball), ValueError, "revolute"),
        (lambda: world.add_joint("revolute", ball, point=(0, 0, 0)), TypeError, "axis"),
        (lambda: world.add_joint("revolute", point=(0, 0, 0), axis=(0, 0, 1)), TypeError, "a body"),
        (lambda: world.add_joint("gear", joints=(0, 1), ratio=1.0), IndexError, "no joint"),
        (lambda: world.add_joint("spherical", ball, point=(0, 0, 0), speed=1.0), ValueError, "motor"),
        (lambda: world.add_joint("fixed", ball, speed=1.0, force=1.0), TypeError, "motor"),
        (lambda: world.add_joint("distance", ball, ends=((0, 0, 0), (0, 0, 1)), rest=1.0), TypeError, "stiffness"),
    ]:
        with pytest.raises(error, match=message):
            wrong()
    assert world.joints == []
