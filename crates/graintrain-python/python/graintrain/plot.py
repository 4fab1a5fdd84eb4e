"""Standard plots; they need matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from graintrain._graintrain import SolveReport, World


def _axes(axes: Any) -> Any:
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots()[1]


def convergence(reports: Mapping[str, SolveReport], axes: Any = None, *, over: str = "seconds") -> Any:
    """Residual of the worst contact over seconds or iterations, a line for each solver. Returns the axes."""
    axes = _axes(axes)
    column = {"iterations": 0, "seconds": 1}[over]
    for name, report in reports.items():
        history = report.history
        axes.plot(history[:, column], history[:, 3], label=name)
    axes.set_yscale("log")
    axes.set_xlabel("seconds" if over == "seconds" else "iterations")
    axes.set_ylabel("residual of the worst contact")
    axes.legend()
    return axes


def forces(world: World, axes: Any = None, *, bins: int = 40) -> Any:
    """Distribution of the normal contact forces over their mean, after the last step. Returns the axes."""
    import numpy as np

    axes = _axes(axes)
    contacts = world.contacts
    normal = np.einsum("ij,ij->i", contacts.impulses, contacts.normals) / world.dt
    pressing = normal[normal > 1e-6 * normal.mean()] if normal.size else normal
    axes.hist(pressing / pressing.mean() if pressing.size else [], bins=bins, density=True)
    axes.set_yscale("log")
    axes.set_xlabel("normal force over its mean")
    axes.set_ylabel("probability density")
    return axes
