"""Pictures, replays, plots."""

from __future__ import annotations

import html

import numpy as np
import pytest

import graintrain
from graintrain import plot


def test_a_picture_is_a_png_of_the_state(drop, tmp_path):
    drop.run(0.2)
    picture = drop.render(320, 200, color="force", force_chains=True, view=(30, 10))
    assert picture._repr_png_().startswith(b"\x89PNG\r\n\x1a\n") and drop._repr_png_().startswith(b"\x89PNG")
    pixels = picture.to_numpy()
    assert pixels.shape == (200, 320, 3) and pixels.dtype == np.uint8
    grains = (pixels != 255).any(axis=2).mean()
    assert 0.02 < grains < 1.0 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20
    picture.save(tmp_path / "pile.png")
    assert (tmp_path / "pile.png").read_bytes() == picture.png
    for wrong, message in [({"color": "taste"}, "speed"), ({"width": 3}, "64"), ({"range": (2, 1)}, "range")]:
        with pytest.raises(ValueError, match=message):
            drop.render(**wrong)


def test_a_recorded_run_becomes_a_replay(drop, tmp_path):
    other = drop.copy()
    drop.record(tmp_path / "run", 0.1, every=10)
    other.run(0.1)
    assert drop.state_hash == other.state_hash
    assert (tmp_path / "run/summary.json").exists() and len(list((tmp_path / "run/frames").glob("bodies*.vtp"))) == 6
    graintrain.replay(tmp_path / "run", tmp_path / "x.html")
    assert "<html" in (tmp_path / "x.html").read_text()
    checkpoint = max((tmp_path / "run/checkpoints").iterdir())
    assert graintrain.World.from_bytes(checkpoint.read_bytes()).state_hash == drop.state_hash
    with pytest.raises(FileExistsError):
        drop.record(tmp_path / "run", 0.2)
    drop.record(tmp_path / "run", 0.12, force=True)
    drop.replay(tmp_path / "y.html", 0.14, every=2)
    assert drop.time == pytest.approx(0.14) and (tmp_path / "y.html").stat().st_size > 10_000
    with pytest.raises(OSError, match="nowhere"):
        graintrain.replay(tmp_path / "nowhere", tmp_path / "z.html")


def test_worlds_and_folders_are_shown_in_notebooks(drop, tmp_path):
    still = graintrain.show(drop)
    assert drop.time == 0 and still.page.startswith("<!doctype html>") and "<script" in still.page
    shown = graintrain.show(drop, 0.1, every=10, height=400)
    assert drop.time == pytest.approx(0.1)
    frame = shown._repr_html_()
    assert frame.startswith("<iframe") and "height:400px" in frame
    assert html.unescape(frame.split('srcdoc="')[1].split('"')[0]) == shown.page
    shown.save(tmp_path / "x.html")
    assert (tmp_path / "x.html").read_text(encoding="utf-8") == shown.page
    drop.record(tmp_path / "run", 0.12)
    assert "<script" in graintrain.show(tmp_path / "run").page
    with pytest.raises(ValueError, match="belong to a world"):
        graintrain.show(tmp_path / "run", 0.2)
    with pytest.raises(OSError, match="nowhere"):
        graintrain.show(tmp_path / "nowhere")


def test_plots(drop):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    drop.run(0.5)
    problem, _ = drop.problem
    reports = {name: problem.solve(name, tolerance=1e-6)[1] for name in ["apgd", "ipm"]}
    for over in ["seconds", "iterations"]:
        axes = plot.convergence(reports, over=over)
        assert len(axes.lines) == 2 and axes.get_yscale() == "log"
    assert plot.forces(drop).patches
