"""The package: version, command line, stubs."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys

import pytest

import graintrain
from graintrain import _graintrain


def run(*words: str, **settings) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "graintrain", *words], capture_output=True, text=True, **settings)


def test_the_command_line(tmp_path):
    version = run("--version")
    assert version.returncode == 0 and version.stdout.split() == ["graintrain", graintrain.__version__]
    out = tmp_path / "out"
    done = run("run", "stack", "--steps", "5", "--quiet", "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert (out / "summary.json").exists()
    # The same run from here has the same state.
    world = graintrain.World.from_scene("stack")
    world.run(steps=5)
    assert f"{world.state_hash:016x}" in (out / "summary.json").read_text() or str(world.state_hash) in (out / "summary.json").read_text()
    assert run("check", "no-such-scene").returncode == 2
    assert run("dance").returncode == 2


def test_everything_has_a_docstring():
    for name in graintrain.__all__:
        thing = getattr(graintrain, name)
        if name.startswith("__"):
            continue
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing):
            for member, value in vars(thing).items():
                if not member.startswith("_"):
                    assert inspect.getdoc(value), f"{name}.{member}"


def test_the_stubs_name_what_there_is():
    stub = os.path.join(os.path.dirname(graintrain.__file__), "_graintrain.pyi")
    import ast

    with open(stub) as text:
        tree = ast.parse(text.read())
    named = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    there = {name for name in vars(_graintrain) if not name.startswith("_")}
    assert there == {name for name in named if not name.startswith("_")}
    for name, node in named.items():
        if isinstance(node, ast.ClassDef) and name in there:
            stated = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
            real = set(vars(getattr(_graintrain, name)))
            if name == "StepReport":
                # The columns of steps.csv, found by name.
                real |= set(graintrain.World().step().to_dict())
            hidden = {"__new__", "__init__"}
            assert {member for member in real if not member.startswith("_")} <= stated, name
            assert stated - hidden <= real | {"__init__"}, (name, stated - real)


def test_a_checker_accepts_the_stubs(tmp_path):
    pytest.importorskip("mypy")
    script = tmp_path / "use.py"
    script.write_text(
        "import numpy as np\nimport graintrain\n"
        "world = graintrain.World(step=1e-3)\n"
        "ball: int = world.add_body(graintrain.Shape.sphere(0.1), (0, 0, 1))\n"
        "world.velocities[ball] = [1, 0, 0]\n"
        "world.run(0.1, callback=lambda w: w.time > 0.05)\n"
        "report = world.step()\n"
        "impulse, solved = graintrain.Problem.from_matrix(np.eye(3), np.zeros(3), [0.1]).solve('ipm')\n"
        "x: float = solved.residual[0]\n"
    )
    check = [sys.executable, "-m", "mypy", "--strict", str(script)]
    done = subprocess.run(check, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    script.write_text("import graintrain\ngraintrain.World(step='fast').run(untill=3)\n")
    assert subprocess.run(check, capture_output=True, text=True, cwd=tmp_path).returncode != 0
