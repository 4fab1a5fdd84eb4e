"""What stepping from Python costs beside the command line, and what a batch gains: ratios in one process or of interleaved processes.

    python crates/graintrain-python/benches/stepping.py [overhead|batch]

overhead: processor seconds of one thread for the steps of `sedimentation`, the least of several repetitions that take turns: by the command line
(its own count), by World.record, which writes the same files, by World.run, which writes none, by a loop over World.step, and with a callback
that reads an array after every step.
batch: wall and processor seconds of 64 small worlds one by one, and by Batch.run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time


def by_command_line(n: int, steps: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        words = ["run", "sedimentation", "--set", f"n={n}", "--steps", str(steps), "--quiet", "--out", f"{folder}/run"]
        words += ["--set", "output.every=100 s"]
        subprocess.run([sys.executable, "-m", "graintrain", *words], check=True, capture_output=True)
        with open(f"{folder}/run/summary.json") as file:
            summary = json.load(file)
    return summary["cpu_seconds"]


def by_python(n: int, steps: int, way: str) -> float:
    import graintrain

    world = graintrain.World.from_scene("sedimentation", set={"n": n})
    heights = []
    start = time.process_time()
    if way == "record":
        with tempfile.TemporaryDirectory() as folder:
            world.record(f"{folder}/run", steps=steps, every=10**6, contacts=False)
    elif way == "run":
        world.run(steps=steps)
    elif way == "step":
        for _ in range(steps):
            world.step()
    else:
        world.run(steps=steps, callback=lambda w: heights.append(w.positions[:, 2].mean()))
    return time.process_time() - start


def overhead(n: int, steps: int, repetitions: int) -> None:
    ways = {"command line": lambda: by_command_line(n, steps)}
    ways |= {way: (lambda way=way: by_python(n, steps, way)) for way in ["record", "run", "step", "callback"]}
    least = {name: float("inf") for name in ways}
    for _ in range(repetitions):
        for name, way in ways.items():
            least[name] = min(least[name], way())
    print(f"{(2 * n + 1) ** 3} bodies and a mixer, {steps} steps, one thread, processor seconds, least of {repetitions}:")
    for name, seconds in least.items():
        print(f"  {name:14} {seconds:8.4f} s   {seconds / least['command line'] - 1:+.1%}")


def batch(count: int) -> None:
    import numpy as np

    import graintrain

    def pile(seed: int) -> graintrain.World:
        world = graintrain.World(step=2e-3, envelope=3e-3)
        world.add_plane()
        places = 0.022 * np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) + [0, 0, 0.02]
        world.add_bodies(graintrain.Shape.sphere(0.01), places + np.random.default_rng(seed).uniform(0, 1e-3, places.shape))
        return world

    for _ in range(3):
        alone, together = [pile(seed) for seed in range(count)], [pile(seed) for seed in range(count)]
        start = time.perf_counter(), time.process_time()
        for world in alone:
            world.run(0.4)
        middle = time.perf_counter(), time.process_time()
        graintrain.Batch(together).run(0.4)
        end = time.perf_counter(), time.process_time()
        assert [a.state_hash for a in alone] == [b.state_hash for b in together]
        print(
            f"{count} worlds of 64 balls: one by one {middle[0] - start[0]:.2f} s wall, {middle[1] - start[1]:.2f} s processor; "
            f"batch {end[0] - middle[0]:.2f} s wall, {end[1] - middle[1]:.2f} s processor; {(middle[0] - start[0]) / (end[0] - middle[0]):.2f} x"
        )


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["overhead", "batch"]
    if "overhead" in chosen:
        # Threads are chosen when the package is loaded first.
        os.environ["RAYON_NUM_THREADS"] = "1"
        overhead(4, 60, 5)
    if "batch" in chosen:
        os.environ.pop("RAYON_NUM_THREADS", None)
        if "overhead" in chosen:
            sys.exit(subprocess.run([sys.executable, __file__, "batch"]).returncode)
        batch(64)
