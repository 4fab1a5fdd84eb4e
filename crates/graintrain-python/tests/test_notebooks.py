"""The notebooks run, in well under a minute, and print what they say they print."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest
from run_notebook import printed, stored

EXAMPLES = Path(os.environ.get("GRAINTRAIN_EXAMPLES", Path(__file__).parent.parent / "examples"))
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))


def test_all_are_here():
    assert [path.name for path in NOTEBOOKS] == ["trains.ipynb"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path):
    notebook = json.loads(path.read_text())
    assert notebook["nbformat"] == 4
    began = time.monotonic()
    assert printed(notebook) == stored(notebook)
    assert time.monotonic() - began < 30
