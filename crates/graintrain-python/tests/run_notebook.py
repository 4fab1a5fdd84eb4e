"""Notebooks without Jupyter: the code cells of a file, run in order in one namespace.

    python run_notebook.py NOTEBOOK...     runs them and stores what they print
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path


def printed(notebook: dict) -> list[str]:
    """What every code cell prints."""
    namespace: dict = {"__name__": "__main__"}
    texts = []
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] != "code":
            continue
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile("".join(cell["source"]), f"<cell {number}>", "exec"), namespace)
        texts.append(out.getvalue())
    return texts


def stored(notebook: dict) -> list[str]:
    """What the file says that every code cell printed."""
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return ["".join("".join(output["text"]) for output in cell["outputs"]) for cell in cells]


def store(path: Path) -> None:
    """Runs a notebook and writes what its cells print into it."""
    notebook = json.loads(path.read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, (cell, text) in enumerate(zip(cells, printed(notebook)), start=1):
        cell["execution_count"] = number
        lines = text.splitlines(keepends=True)
        cell["outputs"] = [{"name": "stdout", "output_type": "stream", "text": lines}] if lines else []
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    for word in sys.argv[1:]:
        store(Path(word))
