"""What the extension module takes as plain lists, made of arrays and SciPy's sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

Coordinates = tuple[int, int, list[int], list[int], list[float]]


def coordinates(what: str, matrix: Any) -> Coordinates:
    """A matrix as (rows, columns, row indices, column indices, values); anything with tocoo() is taken for sparse."""
    if hasattr(matrix, "tocoo"):
        sparse = matrix.tocoo()
        rows, columns = sparse.shape
        return int(rows), int(columns), sparse.row.tolist(), sparse.col.tolist(), sparse.data.astype(float).tolist()
    full = np.asarray(matrix, dtype=float)
    if full.ndim != 2:
        raise ValueError(f"{what} has the shape {full.shape}, expected two dimensions")
    row, column = np.nonzero(full)
    return full.shape[0], full.shape[1], row.tolist(), column.tolist(), full[row, column].tolist()


def flat(what: str, array: Any, size: int) -> list[float]:
    """So many numbers of an array of any shape."""
    numbers = np.asarray(array, dtype=float).ravel()
    if numbers.size != size:
        raise ValueError(f"{what} has {numbers.size} numbers, expected {size}")
    return numbers.tolist()


def local_problem(w: Any, q: Any, mu: Any) -> tuple[Coordinates, list[float], list[float]]:
    """The parts of u = W g + q."""
    matrix = coordinates("w", w)
    return matrix, flat("q", q, matrix[1]), flat("mu", mu, matrix[1] // 3)


def global_problem(d: Any, inverse_mass: Any, r: Any, mu: Any) -> tuple[Coordinates, Coordinates, list[float], list[float]]:
    """The parts of u = D^T M^-1 D g + r: M and D, without what acts on rows that do not move."""
    rows, columns, row, column, value = coordinates("d", d)
    masses, moves = inverted_masses(inverse_mass, rows)
    kept = [(i, j, x) for i, j, x in zip(row, column, value) if moves[i]]
    row, column, value = [i for i, _, _ in kept], [j for _, j, _ in kept], [x for _, _, x in kept]
    return masses, (rows, columns, row, column, value), flat("r", r, columns), flat("mu", mu, columns // 3)


def inverted_masses(inverse_mass: Any, freedoms: int) -> tuple[Coordinates, np.ndarray]:
    """M from M^-1, block by block, and which degrees of freedom have a mass. Rows of M^-1 that are zero belong to what does not move: M is 1
    there."""
    if hasattr(inverse_mass, "tocoo"):
        blocks = sparse_blocks(inverse_mass.tocoo(), freedoms)
    else:
        given = np.asarray(inverse_mass, dtype=float)
        if given.ndim == 3 and given.shape[1] == given.shape[2] and given.shape[0] * given.shape[1] == freedoms:
            size = given.shape[1]
            blocks = [(np.arange(k * size, (k + 1) * size), block) for k, block in enumerate(given)]
        elif given.size == freedoms:
            blocks = [(np.array([k]), np.array([[x]])) for k, x in enumerate(given.ravel())]
        else:
            raise ValueError(
                f"inverse_mass has the shape {given.shape}, expected ({freedoms},), blocks (n, 6, 6) for {freedoms} rows, or a sparse matrix"
            )
    row: list[int] = []
    column: list[int] = []
    value: list[float] = []
    moves = np.ones(freedoms, dtype=bool)
    for place, block in blocks:
        held = ~block.any(axis=1)
        moves[place[held]] = False
        free = place[~held]
        row += place[held].tolist()
        column += place[held].tolist()
        value += [1.0] * int(held.sum())
        if free.size:
            try:
                mass = np.linalg.inv(block[np.ix_(~held, ~held)])
            except np.linalg.LinAlgError:
                raise ValueError(f"inverse_mass is singular in rows {free.tolist()}") from None
            filled = np.nonzero(mass)
            row += free[filled[0]].tolist()
            column += free[filled[1]].tolist()
            value += mass[filled].tolist()
    return (freedoms, freedoms, row, column, value), moves


def sparse_blocks(matrix: Any, freedoms: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The independent blocks of a sparse matrix: the places of each, and its numbers."""
    if matrix.shape != (freedoms, freedoms):
        raise ValueError(f"inverse_mass has the shape {matrix.shape}, expected ({freedoms}, {freedoms})")
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(matrix, directed=False)
    order = np.argsort(label, kind="stable")
    places = np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1])
    rows = matrix.tocsr()
    return [(place, rows[place][:, place].toarray()) for place in places]
