"""Many runs of a scene with other parameters, to a table."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from graintrain._graintrain import Batch, World


def sweep(
    scene: Any,
    parameters: Mapping[str, Sequence[Any]],
    measure: Callable[[World], Mapping[str, Any]],
    *,
    until: float | str | None = None,
    steps: int | None = None,
    set: Mapping[str, Any] | None = None,
    side_by_side: int | None = None,
) -> Any:
    """Runs a scene with every combination of the parameters' values and returns a row for each: the parameters and what measure(world)
    gives at its end. A pandas frame where pandas is installed, else a list of dicts.

    The parameters are changes of the scene as in World.from_scene(set=...); `set` holds those that all runs share. `side_by_side` worlds
    (64 unless given) are in memory at a time, stepped over the cores.
    """
    names = list(parameters)
    combinations = list(itertools.product(*(parameters[name] for name in names)))
    count = side_by_side or 64
    rows: list[dict[str, Any]] = []
    for start in range(0, len(combinations), count):
        part = [dict(zip(names, values)) for values in combinations[start : start + count]]
        worlds = [World.from_scene(scene, set={**(set or {}), **changes}) for changes in part]
        Batch(worlds).run(until, steps=steps)
        rows += [{**changes, **measure(world)} for changes, world in zip(part, worlds)]
    try:
        import pandas
    except ImportError:
        return rows
    return pandas.DataFrame(rows)
