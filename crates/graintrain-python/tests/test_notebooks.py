"""The notebooks run, in well under a minute, and print what they say they print; so do the example scripts of the book, as notebooks."""

from __future__ import annotations

import ast
import json
import os
import sys
import time
import types
from pathlib import Path

import pytest
from make_notebook import notebook as notebook_of
from run_notebook import printed, stored

EXAMPLES = Path(os.environ.get("GRAINTRAIN_EXAMPLES", Path(__file__).parent.parent / "examples"))
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


def test_all_are_here():
    assert [path.name for path in NOTEBOOKS] == ["trains.ipynb"]
    assert len(SCRIPTS) == 6


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path):
    notebook = json.loads(path.read_text())
    assert notebook["nbformat"] == 4
    began = time.monotonic()
    assert printed(notebook) == stored(notebook)
    assert time.monotonic() - began < 30


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_scripts_as_notebooks(script, tmp_path, monkeypatch):
    """What `make_notebook.py` makes of an example has all its code, and runs; its pictures are there where cells show them."""
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    # Shorter than what the book shows: the same code with fewer bodies.
    monkeypatch.setenv("GRAINTRAIN_SMALL", "1")
    shown = []

    def image(name):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
        shown.append(name)

    monkeypatch.setitem(sys.modules, "IPython.display", types.SimpleNamespace(Image=image))
    text = script.read_text(encoding="utf-8")
    made = notebook_of(text)
    cells = ["".join(cell["source"]) for cell in made["cells"]]
    assert cells[0].startswith("# ")
    statements = [ast.unparse(node) for cell in cells[1:] for node in ast.parse(cell).body]
    own = [statement for statement in statements if "Image" not in statement]
    assert sorted(own) == sorted(ast.unparse(node) for node in ast.parse(text).body[1:])
    assert any(printed(made))
    assert len(shown) == text.count(".png\"")
