"""Notebooks of the examples: the script's docstring as text, its paragraphs as cells, its pictures shown where they are saved.

    python make_notebook.py SCRIPT... FOLDER      executes them with Jupyter (pip install nbclient nbconvert ipykernel) and writes
                                                  FOLDER/SCRIPT.ipynb and FOLDER/SCRIPT.html
"""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path

SAVED = re.compile(r'\b(?:save|savefig)\("([^"]+\.png)"')


def paragraphs(script: str) -> tuple[str, list[str]]:
    """The docstring, and the code between blank lines at the top level, functions whole."""
    tree, lines = ast.parse(script), script.splitlines()
    inside = {n for node in tree.body for n in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    text, begin = ast.get_docstring(tree) or "", tree.body[0].end_lineno if ast.get_docstring(tree) else 0
    cells, cell = [], []
    for number, line in enumerate(lines[begin:], start=begin + 1):
        if line.strip() or number in inside:
            cell.append(line)
        elif cell:
            cells.append("\n".join(cell))
            cell = []
    return text, [*cells, "\n".join(cell)] if cell else cells


def notebook(script: str) -> dict:
    """The script as a notebook of format 4.5, without outputs. Imports make one cell."""
    text, cells = paragraphs(script)
    imports = [cell for cell in cells if all(isinstance(node, ast.Import | ast.ImportFrom) for node in ast.parse(cell).body)]
    rest = [cell for cell in cells if cell not in imports]
    if any(SAVED.search(cell) for cell in rest):
        imports.append("from IPython.display import Image")
    pages = [("markdown", "# " + text), ("code", "\n".join(imports))]
    for cell in rest:
        pages.append(("code", cell))
        pages += [("code", f'Image("{name}")') for name in SAVED.findall(cell)]
    return {
        "nbformat": 4,
        "nbformat_minor": 5,
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "cells": [
            {"id": f"cell-{k}", "cell_type": kind, "metadata": {}, "source": source.splitlines(keepends=True)}
            | ({"execution_count": None, "outputs": []} if kind == "code" else {})
            for k, (kind, source) in enumerate(pages)
        ],
    }


def main(scripts: list[Path], folder: Path) -> None:
    import nbformat
    from nbclient import NotebookClient
    from nbconvert import HTMLExporter

    folder.mkdir(parents=True, exist_ok=True)
    for script in scripts:
        made = nbformat.reads(json.dumps(notebook(script.read_text(encoding="utf-8"))), as_version=4)
        NotebookClient(made, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute()
        nbformat.write(made, folder / f"{script.stem}.ipynb")
        (folder / f"{script.stem}.html").write_text(HTMLExporter().from_notebook_node(made)[0], encoding="utf-8")
        print(folder / f"{script.stem}.ipynb")


if __name__ == "__main__":
    *words, last = sys.argv[1:] or sys.exit(__doc__)
    main([Path(word) for word in words], Path(last))
