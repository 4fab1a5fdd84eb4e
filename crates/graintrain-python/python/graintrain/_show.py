"""Replays in notebooks."""

from __future__ import annotations

import html
import os
import tempfile
from pathlib import Path
from typing import Union

from graintrain._graintrain import World, replay


class Replay:
    """A replay, one HTML page without outside files, which notebooks show.

    `page` is its HTML; `save(path)` writes it, to open or to send.
    """

    def __init__(self, page: str, height: int = 600) -> None:
        self.page = page
        self.height = height

    def save(self, path: Union[str, os.PathLike[str]]) -> None:
        """Writes the page."""
        Path(path).write_text(self.page, encoding="utf-8")

    def _repr_html_(self) -> str:
        # A frame of its own: the page's style and script and those of the notebook know nothing of each other.
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" sandbox="allow-scripts allow-downloads" '
            f'style="width:100%;height:{self.height}px;border:0" title="replay"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<graintrain.Replay: {len(self.page) / 1e6:.1f} MB>"


def show(
    what: Union[World, str, os.PathLike[str]],
    until: Union[float, str, None] = None,
    *,
    steps: int | None = None,
    every: int | None = None,
    max_frames: int = 240,
    force_chains: bool = True,
    height: int = 600,
) -> Replay:
    """Shows a world or a run in the notebook: turn it, play it, pick bodies, follow its figures.

    A world runs `until` a time or for so many `steps` first, with a frame every `every` steps; without either, its present state is
    shown. A path is the folder of a run. `height` is that of the frame, pixels.
    """
    with tempfile.TemporaryDirectory() as folder:
        page = os.path.join(folder, "replay.html")
        if not isinstance(what, World):
            if until is not None or steps is not None or every is not None:
                raise ValueError("until, steps and every belong to a world; the run in a folder is over")
            replay(what, page, max_frames=max_frames, force_chains=force_chains)
        else:
            steps = 0 if until is None and steps is None else steps
            what.replay(page, until, steps=steps, every=every, max_frames=max_frames, force_chains=force_chains)
        return Replay(Path(page).read_text(encoding="utf-8"), height)
