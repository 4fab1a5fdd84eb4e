"""The example scripts, as they stand in the book."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(os.environ.get("GRAINTRAIN_EXAMPLES", Path(__file__).parent.parent / "examples"))
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


def test_all_are_here():
    assert len(SCRIPTS) == 6


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_example(script, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    # Shorter than what the book shows: the same code with fewer bodies.
    monkeypatch.setenv("GRAINTRAIN_SMALL", "1")
    runpy.run_path(str(script), run_name="__main__")
