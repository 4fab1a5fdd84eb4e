#!/usr/bin/env python3
"""Boxes and hulls: a pyramid that stands and a pile that falls, in graintrain and in every peer that is there, one thread each.

    benches/peers/bodies_with_corners.py                                      small scenes; table, CSV, plot
    benches/peers/bodies_with_corners.py --pyramid 100 --layers 80            5 050 boxes, 5 120 hulls: the sizes of Box3D's own benchmark
    benches/peers/bodies_with_corners.py --box3d ~/src/box3d --out corners    with Box3D, compiled from a checkout of its source

Peers: rapier and MuJoCo (pip install rapier3d mujoco), Box3D (https://github.com/erincatto/box3d, needs a C compiler). Needs numpy and
scipy, and matplotlib for the plot. Every program makes steps at its own settings: rapier and Box3D (four sub-steps) 1/60 s, as their
benchmarks do; MuJoCo 5 ms; graintrain 1/60 s at two tolerances. Compared: processor seconds per body and step of 1/60 s, and what
the bodies do, evaluated here from positions and orientations alone: the largest overlap (diameter of the largest ball inside two
bodies, or depth below the floor) at any of ten samples, and how far boxes of the pyramid, which stands, have moved.

Scenes (after Box3D's benchmark): cubes of 1 m; the same hull of 32 points on a sphere of 2 m many times, 8 x 8 in a layer, the layers
4.2 m apart. 100 kg/m^3, friction 0.6, no restitution.
"""
import argparse
import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import time

os.environ["OMP_NUM_THREADS"] = os.environ["RAYON_NUM_THREADS"] = "1"
import numpy as np  # noqa: E402  (the number of threads comes first)

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from common_drop import numbers_of, positions, write  # noqa: E402

DENSITY, FRICTION, GRAVITY, STEP, SAMPLES = 100.0, 0.6, 9.81, 1 / 60, 10
CUBE = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def pyramid(base):
    """Corners of the body, and the places of all."""
    places = [(i / 2 + j - base / 2, 0.0, i + 0.5) for i in range(base) for j in range(base - i)]
    return CUBE, np.array(places)


def pile(layers):
    from scipy.spatial import ConvexHull

    points = np.random.RandomState(42).normal(size=(32, 3))
    points *= 2 / np.linalg.norm(points, axis=1)[:, None]
    solid, centre = 0.0, np.zeros(3)
    for face in ConvexHull(points).simplices:
        volume = abs(np.linalg.det(points[face])) / 6
        solid, centre = solid + volume, centre + volume * points[face].sum(0) / 4
    points -= centre / solid
    places = [(4.0 * x - 14, 4.0 * y - 14, 2.1 + 4.2 * z) for z in range(layers) for y in range(8) for x in range(8)]
    return points, np.array(places)


# What bodies do


def rotations(quaternions):
    """Rotation matrices of quaternions (w, x, y, z)."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1)[:, None]).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def faces(corners):
    """Outward unit normals and offsets, n . x <= d."""
    from scipy.spatial import ConvexHull

    planes = np.unique(np.round(ConvexHull(corners).equations, 9), axis=0)
    return planes[:, :3], -planes[:, 3]


def overlap(corners, positions, quaternions):
    """The largest overlap of two bodies, or of one and the floor, m."""
    from scipy.optimize import linprog
    from scipy.spatial import cKDTree

    normals, offsets = faces(corners)
    turned = rotations(quaternions)
    points = np.einsum("bij,kj->bki", turned, corners) + positions[:, None]
    deepest = max(0.0, -points[:, :, 2].min())
    reach = 2 * np.linalg.norm(corners, axis=1).max()
    for a, b in cKDTree(positions).query_pairs(reach):
        # Along the faces' normals: an upper bound.
        depths = []
        for own, other in ((a, b), (b, a)):
            directions = normals @ turned[own].T
            along = directions @ (points[other] - positions[own]).T
            depths.append((offsets - along.min(1)).min())
        if min(depths) <= deepest:
            continue
        rows = np.concatenate([normals @ turned[a].T, normals @ turned[b].T])
        limits = np.concatenate([offsets, offsets + (normals @ turned[b].T) @ (positions[b] - positions[a])])
        found = linprog([0, 0, 0, -1], np.c_[rows, np.ones(len(rows))], limits, bounds=[(None, None)] * 4, method="highs")
        deepest = max(deepest, 2 * found.x[3])
    return deepest


def measured(corners, places, samples):
    """Largest overlap, and the way of the body that went furthest, of samples (positions, quaternions)."""
    overlaps = [overlap(corners, *sample) for sample in samples]
    return max(overlaps), np.linalg.norm(samples[-1][0] - places, axis=1).max()


# Programs


def graintrain(program, corners, places, steps, tolerance, folder):
    shape = f"hull = {{ points = {np.round(corners, 12).tolist()} }}"
    if corners is CUBE:
        shape = "box = { size = [1, 1, 1] }"
    text = f"""title = "bodies with corners"
[time]
step = "{STEP!r} s"
steps = {steps}
[output]
every = "{steps // SAMPLES * STEP!r} s"
contacts = false
precision = "double"
[material.stuff]
density = {DENSITY}
friction = {FRICTION}
[body.floor]
shape = {{ plane = {{}} }}
motion = "fixed"
"""
    bodies = [f"[body.b{k}]\nshape = {{ {shape} }}\nposition = {place.tolist()}\n" for k, place in enumerate(places)]
    path, out = os.path.join(folder, "scene.toml"), os.path.join(folder, "out")
    open(path, "w", encoding="ascii").write(text + "".join(bodies))
    run = [program, "run", path, "--tolerance", tolerance, "--threads", "1", "--quiet", "--force", "--out", out]
    subprocess.run(run, check=True)
    summary = json.load(open(os.path.join(out, "summary.json")))
    frames = sorted(name for name in os.listdir(os.path.join(out, "frames")) if re.fullmatch(r"bodies_\d+.vtp", name))
    samples = [frame(os.path.join(out, "frames", name)) for name in frames[1:]]
    return summary["cpu_seconds"], samples


def frame(path):
    """Positions and quaternions (w, x, y, z) of the bodies of a frame, which has them as (x, y, z, w)."""
    return positions(path), numbers_of(path, "quat").reshape(-1, 4)[:, [3, 0, 1, 2]]


def rapier(corners, places, steps, _):
    import rapier3d as r

    world = r.PhysicsWorld(gravity=(0.0, 0.0, -GRAVITY))
    world.integration_parameters.dt = STEP

    def built(thing):
        return thing.build() if hasattr(thing, "build") else thing

    floor = built(r.Collider.cuboid(1000.0, 1000.0, 1.0))
    floor.friction, floor.restitution, floor.translation = FRICTION, 0.0, (0.0, 0.0, -1.0)
    world.add_collider(floor)
    handles = []
    for place in places:
        solid = r.Collider.cuboid(0.5, 0.5, 0.5) if corners is CUBE else r.Collider.convex_hull(corners.tolist())
        solid = built(solid)
        solid.friction, solid.restitution, solid.density = FRICTION, 0.0, DENSITY
        body = built(r.RigidBody.dynamic(translation=tuple(place)))
        handle = world.add_body(body, colliders=[solid])
        handles.append(handle[0] if isinstance(handle, tuple) else handle)
    seconds, samples = 0.0, []

    def numbers(thing, names):
        thing = thing() if callable(thing) else thing
        return [getattr(thing, name) for name in names] if hasattr(thing, names[0]) else list(thing)

    for k in range(steps):
        for handle in handles:
            if world.rigid_bodies[handle].is_sleeping:
                world.rigid_bodies[handle].wake_up(True)
        begin = time.process_time()
        world.step()
        seconds += time.process_time() - begin
        if (k + 1) % (steps // SAMPLES) == 0:
            bodies = [world.rigid_bodies[handle] for handle in handles]
            places_now = np.array([numbers(body.translation, "xyz") for body in bodies])
            samples.append((places_now, np.array([numbers(body.rotation, "wijk") for body in bodies])))
    return seconds, samples


def mujoco(corners, places, steps, _):
    import mujoco as mj

    inner = 5e-3
    solid = 'type="box" size="0.5 0.5 0.5"' if corners is CUBE else 'type="mesh" mesh="solid"'
    vertices = " ".join(f"{x:.12g}" for x in corners.ravel())
    asset = "" if corners is CUBE else f'<asset><mesh name="solid" vertex="{vertices}"/></asset>'
    text = [f'<mujoco><option timestep="{inner}" gravity="0 0 -{GRAVITY}" solver="CG" cone="elliptic" jacobian="sparse"/>']
    text += ['<size memory="8G"/>', f'<default><geom friction="{FRICTION} 0 0" condim="3" solref="0.01 1" density="{DENSITY}"/></default>']
    text += [asset, '<worldbody><geom type="plane" size="0 0 1"/>']
    text += [f'<body pos="{x} {y} {z}"><freejoint/><geom {solid}/></body>' for x, y, z in places]
    model = mj.MjModel.from_xml_string("\n".join(text) + "</worldbody></mujoco>")
    data = mj.MjData(model)
    seconds, samples = 0.0, []
    for _ in range(SAMPLES):
        begin = time.process_time()
        for _ in range(round(steps / SAMPLES * STEP / inner)):
            mj.mj_step(model, data)
        seconds += time.process_time() - begin
        states = data.qpos.reshape(-1, 7)
        samples.append((states[:, :3].copy(), states[:, 3:].copy()))
    return seconds, samples


DRIVER = r"""
#include "box3d/box3d.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
int main(int argc, char** argv) {
    FILE* in = fopen(argv[1], "r");
    int corners, bodies, steps, every;
    float step, friction, density, gravity;
    if (fscanf(in, "%d %d %d %d %f %f %f %f", &corners, &bodies, &steps, &every, &step, &friction, &density, &gravity) != 8) return 1;
    b3WorldDef world = b3DefaultWorldDef();
    world.gravity = (b3Vec3){0, 0, -gravity};
    world.enableSleep = false;
    b3WorldId id = b3CreateWorld(&world);
    b3ShapeDef shape = b3DefaultShapeDef();
    shape.density = density;
    shape.baseMaterial.friction = friction;
    shape.baseMaterial.restitution = 0;
    b3BodyDef body = b3DefaultBodyDef();
    body.position = (b3Pos){0, 0, -1};
    b3BoxHull ground = b3MakeBoxHull(1000, 1000, 1);
    b3CreateHullShape(b3CreateBody(id, &body), &shape, &ground.base);
    b3Vec3* points = malloc(corners * sizeof(b3Vec3));
    for (int k = 0; k < corners; ++k) if (fscanf(in, "%f %f %f", &points[k].x, &points[k].y, &points[k].z) != 3) return 1;
    b3HullData* hull = b3CreateHull(points, corners, corners);
    b3BodyId* ids = malloc(bodies * sizeof(b3BodyId));
    body.type = b3_dynamicBody;
    for (int k = 0; k < bodies; ++k) {
        double x, y, z;
        if (fscanf(in, "%lf %lf %lf", &x, &y, &z) != 3) return 1;
        body.position = (b3Pos){x, y, z};
        ids[k] = b3CreateBody(id, &body);
        b3CreateHullShape(ids[k], &shape, hull);
    }
    double seconds = 0;
    for (int k = 1; k <= steps; ++k) {
        clock_t begin = clock();
        b3World_Step(id, step, 4);
        seconds += (double)(clock() - begin) / CLOCKS_PER_SEC;
        if (k % every == 0) for (int i = 0; i < bodies; ++i) {
            b3Pos p = b3Body_GetPosition(ids[i]);
            b3Quat q = b3Body_GetRotation(ids[i]);
            printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", (double)p.x, (double)p.y, (double)p.z, q.s, q.v.x, q.v.y, q.v.z);
        }
    }
    fprintf(stderr, "%g\n", seconds);
    return 0;
}
"""


def box3d(corners, places, steps, checkout, folder):
    source, program = os.path.join(folder, "driver.c"), os.path.join(folder, "driver")
    if not os.path.exists(program):
        open(source, "w", encoding="ascii").write(DRIVER)
        own = [os.path.join(checkout, "src", name) for name in os.listdir(os.path.join(checkout, "src")) if name.endswith(".c")]
        include = ["-I", os.path.join(checkout, "include"), "-I", os.path.join(checkout, "src")]
        command = ["cc", "-std=gnu17", "-O3", "-DNDEBUG", "-march=native", *include, source, *own, "-lm", "-lpthread", "-o", program]
        subprocess.run(command, check=True)
    scene = os.path.join(folder, "box3d.txt")
    with open(scene, "w", encoding="ascii") as file:
        file.write(f"{len(corners)} {len(places)} {steps} {steps // SAMPLES} {STEP} {FRICTION} {DENSITY} {GRAVITY}\n")
        np.savetxt(file, corners)
        np.savetxt(file, places)
    ran = subprocess.run([program, scene], check=True, capture_output=True, text=True)
    states = np.array(ran.stdout.split(), dtype=float).reshape(SAMPLES, len(places), 7)
    return float(ran.stderr), [(state[:, :3], state[:, 3:]) for state in states]


def plot(folder, rows):
    try:
        import matplotlib
    except ImportError:
        print("no plot: matplotlib is not installed", file=sys.stderr)
        return
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure, all_axes = plt.subplots(1, len(scenes), figsize=(5 * len(scenes), 4.2), squeeze=False)
    for axes, scene in zip(all_axes[0], scenes):
        for program in dict.fromkeys(row["program"] for row in rows):
            own = [row for row in rows if (row["scene"], row["program"]) == (scene, program)]
            points = [(row["microseconds_per_body_step"], 1e3 * max(row["overlap"], 1e-7)) for row in own]
            axes.plot(*zip(*points), "o-" if len(own) > 1 else "o", label=program)
        axes.set(xscale="log", yscale="log", xlabel="processor microseconds per body and 1/60 s", ylabel="largest overlap, mm", title=scene)
        axes.grid(alpha=0.3)
        axes.legend()
    figure.tight_layout()
    figure.savefig(os.path.join(folder, "bodies_with_corners.svg"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pyramid", type=int, default=20, help="boxes in the lowest row; 0 for none")
    parser.add_argument("--layers", type=int, default=5, help="layers of 64 hulls; 0 for none")
    parser.add_argument("--steps", type=int, default=200, help="steps of 1/60 s, a multiple of ten")
    parser.add_argument("--tolerances", default="1e-2,1e-3", help="of graintrain")
    parser.add_argument("--peers", default="rapier,mujoco,box3d", help="names with commas, or 'none'")
    parser.add_argument("--box3d", help="a checkout of Box3D")
    parser.add_argument("--program", default=os.path.join(ROOT, "target", "release", "graintrain"), help="graintrain itself")
    parser.add_argument("--out", default="bodies_with_corners", help="folder for the CSV and the plot")
    arguments = parser.parse_args()
    if arguments.steps % SAMPLES != 0:
        parser.error(f"--steps is to be a multiple of {SAMPLES}")
    scenes = {}
    if arguments.pyramid:
        scenes[f"pyramid of {arguments.pyramid * (arguments.pyramid + 1) // 2} boxes"] = pyramid(arguments.pyramid)
    if arguments.layers:
        scenes[f"pile of {64 * arguments.layers} hulls"] = pile(arguments.layers)
    rows = []

    def add(scene, program, setting, seconds, samples):
        corners, places = scenes[scene]
        deepest, moved = measured(corners, places, samples)
        per_step = 1e6 * seconds / (len(places) * arguments.steps)
        row = {"scene": scene, "program": program, "setting": setting, "cpu_seconds": seconds}
        rows.append({**row, "microseconds_per_body_step": per_step, "overlap": deepest, "moved": moved})

    peers = [name for name in arguments.peers.split(",") if name != "none"]
    with tempfile.TemporaryDirectory() as folder:
        for scene, (corners, places) in scenes.items():
            for tolerance in arguments.tolerances.split(","):
                ran = graintrain(arguments.program, corners, places, arguments.steps, tolerance, folder)
                add(scene, "graintrain", f"1/60 s, {tolerance}", *ran)
            for name, peer, setting in (("rapier", rapier, "its default, 1/60 s"), ("MuJoCo", mujoco, "CG, elliptic, 5 ms")):
                if name.lower() in peers:
                    try:
                        add(scene, name, setting, *peer(corners, places, arguments.steps, folder))
                    except ImportError:
                        print(f"{name}: not installed, left out", file=sys.stderr)
            if "box3d" in peers and arguments.box3d:
                add(scene, "Box3D", "4 sub-steps, 1/60 s", *box3d(corners, places, arguments.steps, arguments.box3d, folder))
    print("| scene | program | setting | processor s | us per body and step | largest overlap, mm | moved at most, m |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        moved = f"{row['moved']:.3g}" if row["scene"].startswith("pyramid") else ""
        print(
            f"| {row['scene']} | {row['program']} | {row['setting']} | {row['cpu_seconds']:.2f} "
            f"| {row['microseconds_per_body_step']:.2f} | {1e3 * row['overlap']:.3g} | {moved} |"
        )
    write(arguments.out, "bodies_with_corners", rows)
    plot(arguments.out, rows)


if __name__ == "__main__":
    main()
