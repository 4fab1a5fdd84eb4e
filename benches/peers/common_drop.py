#!/usr/bin/env python3
"""The common drop: (2n+1)^3 spheres fall into a box, in graintrain and in every peer that is installed, one thread each.

    benches/peers/common_drop.py --n 4                        graintrain at three tolerances, all peers found; table, CSV, plot
    benches/peers/common_drop.py --n 8 --peers rapier --out results/drop
    benches/peers/common_drop.py --growth 4,8,16              graintrain alone: seconds per settled step against the number of bodies

Peers: rapier, mujoco (pip install rapier3d mujoco), lammps, liggghts, yade (packages of a distribution). Needs numpy and scipy, and
matplotlib for the plots. What is compared: processor seconds of the steps (for programs read from files: of the process), and the
largest overlap at the end and at any of 80 samples (rapier: 60), evaluated here from positions, in per cent of the radius R. The sampling
run of graintrain is a second one with the same bits, so that writing frames is not timed. Penalty codes use the stiffness named.

The job: R = 0.1 m, 1000 kg/m^3, friction 0.25, no restitution, cubic lattice of 0.23 m perturbed by up to 12 mm, floor and four
walls, 2 s.
"""
import argparse
import base64
import csv
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile

os.environ["OMP_NUM_THREADS"] = os.environ["RAYON_NUM_THREADS"] = "1"
import numpy as np  # noqa: E402  (the number of threads comes first)

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
RADIUS, DENSITY, FRICTION, GRAVITY, SECONDS, PITCH, SAMPLE = 0.1, 1000.0, 0.25, 9.81, 2.0, 0.23, 0.025


def lattice(n):
    """Centres of the spheres and the edge of the box, the same for every program."""
    edge = 2 * n + 1
    axis = (np.arange(edge) + 0.5) * PITCH
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)
    points += np.random.RandomState(1).uniform(-0.012, 0.012, points.shape)
    points[:, 2] += 0.05
    return points, edge * PITCH


def overlap(points, side):
    """Largest overlap of two spheres, or of a sphere and a wall, in radii."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(2 * RADIUS, output_type="ndarray")
    distances = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    x, y, z = points.T
    depths = [0.0, *(2 * RADIUS - distances), *(RADIUS - z)]
    depths += [*(RADIUS - x), *(RADIUS - y), *(RADIUS - side + x), *(RADIUS - side + y)]
    return max(depths) / RADIUS


def child_seconds(command, **options):
    """Runs a command and gives the processor seconds of it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, **options)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


# graintrain


def numbers_of(frame, name):
    """An array of a frame of bodies."""
    text = open(frame, encoding="ascii").read()
    data = re.search(rf'<DataArray type="(\w+)" Name="{name}"[^>]*>([^<]*)<', text)
    raw = base64.b64decode(data.group(2).strip())[8:]
    return np.frombuffer(raw, dtype={"Float32": "<f4", "Float64": "<f8"}[data.group(1)]).astype(float)


def positions(frame):
    """Points of a frame of bodies."""
    return numbers_of(frame, "Points").reshape(-1, 3)


def scene(n, folder):
    points, side = lattice(n)
    np.savetxt(os.path.join(folder, "grains.txt"), points, header="x y z", comments="")
    walls = ["{ shape = { plane = { normal = [0, 0, 1] } } }"]
    for axis, sign in [(0, 1), (0, -1), (1, 1), (1, -1)]:
        normal, place = [0, 0, 0], [0.0, 0.0, 0.0]
        normal[axis], place[axis] = sign, 0.0 if sign > 0 else side
        walls.append(f"{{ shape = {{ plane = {{ normal = {normal} }} }}, position = {place} }}")
    text = f"""title = "common drop"
[time]
step = "25 ms"
end = "{SECONDS} s"
[output]
every = "1 s"
contacts = false
precision = "double"
[material.grain]
density = {DENSITY}
friction = {FRICTION}
[body.box]
parts = [{", ".join(walls)}]
[packing.grains]
radius = {RADIUS}
file = {{ path = "grains.txt", format = "table" }}
"""
    path = os.path.join(folder, "drop.toml")
    open(path, "w", encoding="ascii").write(text)
    return path, side


def graintrain(program, n, tolerance, folder, options=()):
    path, side = scene(n, folder)
    run = [program, "run", path, "--tolerance", tolerance, "--threads", "1", "--quiet", "--force", *options]
    out = os.path.join(folder, "timed")
    subprocess.run([*run, "--out", out], check=True)
    summary = json.load(open(os.path.join(out, "summary.json")))
    steps = list(csv.DictReader(open(os.path.join(out, "steps.csv"))))
    sampled = os.path.join(folder, "sampled")
    subprocess.run([*run, "--out", sampled, "--set", f"output.every={SAMPLE}"], check=True)
    frames = sorted(os.listdir(os.path.join(sampled, "frames")))
    frames = [os.path.join(sampled, "frames", name) for name in frames if re.fullmatch(r"bodies_\d+.vtp", name)]
    overlaps = [overlap(positions(frame), side) for frame in frames]
    again = json.load(open(os.path.join(sampled, "summary.json")))
    assert again["state_hash"] == summary["state_hash"], "the sampling run is not the same run"
    name = "graintrain, relaxed friction" if "relaxed" in options else "graintrain"
    return {
        "program": name,
        "setting": f"25 ms, {tolerance}",
        "cpu_seconds": summary["cpu_seconds"],
        "wall_seconds": summary["wall_seconds"],
        "overlap_end": overlaps[-1],
        "overlap_peak": max(overlaps),
        "iterations_per_step": np.mean([float(step["iterations"]) for step in steps]),
    }


# Peers


def rapier(n, _):
    """rapier at its own step of 1/60 s."""
    import time

    import rapier3d as r

    points, side = lattice(n)
    world = r.PhysicsWorld(gravity=(0.0, 0.0, -GRAVITY))
    step = 1 / 60
    world.integration_parameters.dt = step
    half = 0.5
    walls = [((3 * side, 3 * side, half), (side / 2, side / 2, -half))]
    for x in (-half, side + half):
        walls.append(((half, 3 * side, 6 * side), (x, side / 2, side)))
        walls.append(((3 * side, half, 6 * side), (side / 2, x, side)))
    for size, place in walls:
        collider = r.Collider.cuboid(*size)
        collider = collider.build() if hasattr(collider, "build") else collider
        collider.friction, collider.restitution, collider.translation = FRICTION, 0.0, place
        world.add_collider(collider)
    handles = []
    for point in points:
        body = r.RigidBody.dynamic(translation=tuple(point))
        body = body.build() if hasattr(body, "build") else body
        ball = r.Collider.ball(RADIUS)
        ball = ball.build() if hasattr(ball, "build") else ball
        ball.friction, ball.restitution, ball.density = FRICTION, 0.0, DENSITY
        handle = world.add_body(body, colliders=[ball])
        handles.append(handle[0] if isinstance(handle, tuple) else handle)
    cpu = wall = 0.0
    overlaps = []
    for k in range(round(SECONDS / step)):
        begin = time.process_time(), time.perf_counter()
        world.step()
        cpu, wall = cpu + time.process_time() - begin[0], wall + time.perf_counter() - begin[1]
        if k % 2 == 1:
            places = [world.rigid_bodies[handle].translation for handle in handles]
            places = [place() if callable(place) else place for place in places]
            overlaps.append(overlap(np.array([[p.x, p.y, p.z] if hasattr(p, "x") else list(p) for p in places]), side))
    return {"program": "rapier", "setting": "its default, 1/60 s", "cpu_seconds": cpu, "wall_seconds": wall}, overlaps


def mujoco(n, _):
    """MuJoCo with conjugate gradients and elliptic cones at 2.5 ms."""
    import time

    import mujoco as mj

    points, side = lattice(n)
    step = 2.5e-3
    walls = [("0 0 0", "0 0 1"), ("0 0 0", "1 0 0"), (f"{side} 0 0", "-1 0 0"), ("0 0 0", "0 1 0"), (f"0 {side} 0", "0 -1 0")]
    text = [f'<mujoco><option timestep="{step}" gravity="0 0 -{GRAVITY}" solver="CG" cone="elliptic" jacobian="sparse"/>']
    text += ['<size memory="2G"/>', f'<default><geom friction="{FRICTION} 0 0" condim="3" solref="0.005 1" density="{DENSITY}"/></default>']
    text += ["<worldbody>", *(f'<geom type="plane" size="0 0 1" pos="{p}" zaxis="{z}"/>' for p, z in walls)]
    ball = f'<freejoint/><geom type="sphere" size="{RADIUS}"/></body>'
    text += [f'<body pos="{x} {y} {z}">{ball}' for x, y, z in points]
    model = mj.MjModel.from_xml_string("\n".join(text) + "</worldbody></mujoco>")
    data = mj.MjData(model)
    cpu, wall, overlaps = 0.0, 0.0, []
    for _ in range(round(SECONDS / SAMPLE)):
        begin = time.process_time(), time.perf_counter()
        for _ in range(round(SAMPLE / step)):
            mj.mj_step(model, data)
        cpu, wall = cpu + time.process_time() - begin[0], wall + time.perf_counter() - begin[1]
        overlaps.append(overlap(data.qpos.reshape(-1, 7)[:, :3], side))
    return {"program": "MuJoCo", "setting": "CG, elliptic, 2.5 ms", "cpu_seconds": cpu, "wall_seconds": wall}, overlaps


YOUNG, PENALTY_STEP = 5e6, 1e-4


def penalty(program, n, folder, text, command):
    """LAMMPS or LIGGGHTS: an input file, a dump every 25 ms."""
    points, side = lattice(n)
    with open(os.path.join(folder, "data.txt"), "w", encoding="ascii") as file:
        style = "Atoms # sphere" if program == "LAMMPS" else "Atoms"
        file.write(f"drop\n\n{len(points)} atoms\n1 atom types\n-0.1 {side + 0.1} xlo xhi\n-0.1 {side + 0.1} ylo yhi\n")
        file.write(f"-0.1 {2 * side} zlo zhi\n\n{style}\n\n")
        file.writelines(f"{i + 1} 1 {2 * RADIUS} {DENSITY} {x:.9g} {y:.9g} {z:.9g}\n" for i, (x, y, z) in enumerate(points))
    steps = round(SECONDS / PENALTY_STEP)
    dump = f"dump d all custom {round(SAMPLE / PENALTY_STEP)} dump.txt x y z\n"
    with open(os.path.join(folder, "in.txt"), "w", encoding="ascii") as file:
        file.write(text(side) + f"fix g all gravity {GRAVITY} vector 0 0 -1\nthermo {steps}\n" + dump + f"run {steps}\n")
    import time

    begin = time.perf_counter()
    cpu = child_seconds([*command, "-in", "in.txt", "-screen", "none"], cwd=folder)
    wall = time.perf_counter() - begin
    frames = open(os.path.join(folder, "dump.txt"), encoding="ascii").read().split("ITEM: ATOMS x y z")[1:]
    frames = [frame.split("ITEM:")[0] for frame in frames]
    overlaps = [overlap(np.array(frame.split(), dtype=float).reshape(-1, 3), side) for frame in frames]
    setting = f"Hertz, {YOUNG:g} Pa, {PENALTY_STEP:g} s"
    return {"program": program, "setting": setting, "cpu_seconds": cpu, "wall_seconds": wall}, overlaps


def lammps(n, folder):
    law = f"hertz/material {YOUNG} 0.1 0.3 tangential mindlin NULL 1.0 {FRICTION} damping tsuji"
    head = "units si\natom_style sphere\nboundary f f f\nnewton off\ncomm_modify vel yes\nread_data data.txt\nneighbor 0.02 bin\n"
    head += f"neigh_modify delay 0 every 1\npair_style granular\npair_coeff * * {law}\ntimestep {PENALTY_STEP}\n"

    def text(side):
        walls = f"fix w1 all wall/gran granular {law} zplane 0.0 NULL\n"
        walls += "".join(f"fix w{axis} all wall/gran granular {law} {axis}plane 0.0 {side}\n" for axis in "xy")
        return head + walls + "fix i all nve/sphere\n"

    return penalty("LAMMPS", n, folder, text, ["lmp"])


def liggghts(n, folder):
    head = "atom_style granular\natom_modify map array\nboundary f f f\nnewton off\ncommunicate single vel yes\nunits si\n"
    head += "read_data data.txt\nneighbor 0.02 bin\nneigh_modify delay 0\n"
    head += f"fix m1 all property/global youngsModulus peratomtype {YOUNG}\nfix m2 all property/global poissonsRatio peratomtype 0.3\n"
    head += "fix m3 all property/global coefficientRestitution peratomtypepair 1 0.1\n"
    head += f"fix m4 all property/global coefficientFriction peratomtypepair 1 {FRICTION}\n"
    head += f"pair_style gran model hertz tangential history\npair_coeff * *\ntimestep {PENALTY_STEP}\n"

    def text(side):
        wall = "all wall/gran model hertz tangential history primitive type 1"
        planes = ["zplane 0.0", "xplane 0.0", f"xplane {side}", "yplane 0.0", f"yplane {side}"]
        return head + "".join(f"fix w{k} {wall} {plane}\n" for k, plane in enumerate(planes)) + "fix i all nve/sphere\n"

    return penalty("LIGGGHTS", n, folder, text, ["liggghts"])


def yade(n, folder):
    """YADE's linear penalty law at half its critical step."""
    points, side = lattice(n)
    np.savetxt(os.path.join(folder, "grains.txt"), points)
    with open(os.path.join(folder, "drop.py"), "w", encoding="ascii") as file:
        file.write(f"""import json, os, time
import numpy as np
from yade import utils
O.materials.append(FrictMat(young={YOUNG}, poisson=0.3, density={DENSITY}, frictionAngle=np.arctan({FRICTION})))
for point in np.loadtxt("grains.txt"):
    O.bodies.append(utils.sphere(tuple(point), {RADIUS}))
for place, axis, sense in ((0.0, 2, 1), (0.0, 0, 1), ({side}, 0, -1), (0.0, 1, 1), ({side}, 1, -1)):
    O.bodies.append(utils.wall(place, axis=axis, sense=sense))
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()]),
    InteractionLoop([Ig2_Sphere_Sphere_ScGeom(), Ig2_Wall_Sphere_ScGeom()], [Ip2_FrictMat_FrictMat_FrictPhys()],
                    [Law2_ScGeom_FrictPhys_CundallStrack()]),
    NewtonIntegrator(gravity=(0, 0, -{GRAVITY}), damping=0.2),
]
O.dt = 0.5 * utils.PWaveTimeStep()
frames, cpu, wall = [], time.process_time(), time.perf_counter()
for sample in range({round(SECONDS / SAMPLE)}):
    O.run(int(round({SAMPLE} / O.dt)), True)
    frames.append([list(body.state.pos) for body in O.bodies if isinstance(body.shape, Sphere)])
cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
json.dump(dict(cpu=cpu, wall=wall, step=O.dt, frames=frames), open("result.json", "w"))
os._exit(0)
""")
    subprocess.run(["yade", "-n", "-x", "-j1", "drop.py"], cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    result = json.load(open(os.path.join(folder, "result.json")))
    overlaps = [overlap(np.array(frame), side) for frame in result["frames"]]
    setting = f"Cundall-Strack, {YOUNG:g} Pa, {result['step']:.1e} s"
    return {"program": "YADE", "setting": setting, "cpu_seconds": result["cpu"], "wall_seconds": result["wall"]}, overlaps


PEERS = {
    "rapier": (rapier, "rapier3d", None),
    "mujoco": (mujoco, "mujoco", None),
    "lammps": (lammps, None, "lmp"),
    "liggghts": (liggghts, None, "liggghts"),
    "yade": (yade, None, "yade"),
}


def installed(name):
    import importlib.util

    _, module, command = PEERS[name]
    return importlib.util.find_spec(module) is not None if module else shutil.which(command) is not None


def compare(arguments):
    rows = []
    for tolerance in ("1e-2", "1e-3", "1e-4"):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(graintrain(arguments.program, arguments.n, tolerance, folder))
    with tempfile.TemporaryDirectory() as folder:
        rows.append(graintrain(arguments.program, arguments.n, "1e-3", folder, ("--friction", "relaxed")))
    wanted = arguments.peers.split(",") if arguments.peers else list(PEERS)
    for name in wanted:
        if not installed(name):
            print(f"{name}: not installed, left out", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory() as folder:
            row, overlaps = PEERS[name][0](arguments.n, folder)
        rows.append({**row, "overlap_end": overlaps[-1], "overlap_peak": max(overlaps), "iterations_per_step": float("nan")})
    print(f"{(2 * arguments.n + 1) ** 3} spheres, {SECONDS} s, one thread\n")
    print("| program | setting | processor s | wall s | overlap at the end, % R | at most, % R | iterations per step |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        iterations = row["iterations_per_step"]
        print(
            f"| {row['program']} | {row['setting']} | {row['cpu_seconds']:.2f} | {row['wall_seconds']:.2f} "
            f"| {100 * row['overlap_end']:.3g} | {100 * row['overlap_peak']:.3g} | {'' if np.isnan(iterations) else round(iterations)} |"
        )
    write(arguments.out, f"common_drop_{arguments.n}", rows)
    plot_drop(arguments.out, arguments.n, rows)


def grow(arguments):
    """Seconds per step once the bed has settled: the last quarter of the steps."""
    rows = []
    for n in (int(n) for n in arguments.growth.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            path, _ = scene(n, folder)
            out = os.path.join(folder, "out")
            command = [arguments.program, "run", path, "--tolerance", "1e-3", "--threads", "1", "--quiet", "--out", out]
            subprocess.run(command, check=True)
            steps = list(csv.DictReader(open(os.path.join(out, "steps.csv"))))
        settled = steps[3 * len(steps) // 4 :]
        phases = ("seconds_collide", "seconds_assemble", "seconds_solve", "seconds_integrate")
        seconds = np.mean([sum(float(step[phase]) for phase in phases) for step in settled])
        bodies = (2 * n + 1) ** 3
        iterations = np.mean([float(step["iterations"]) for step in settled])
        contacts = np.mean([float(step["contacts"]) for step in settled])
        rows.append({"n": n, "bodies": bodies, "contacts": contacts, "iterations": iterations, "seconds_per_step": seconds})
        print(f"n = {n}: {bodies} bodies, {contacts:.0f} contacts, {iterations:.0f} iterations, {seconds:.4f} s per settled step")
    if len(rows) > 1:
        logs = np.log([[row["bodies"], row["seconds_per_step"]] for row in rows])
        print(f"seconds per step grow like bodies^{np.polyfit(*logs.T, 1)[0]:.2f}")
    write(arguments.out, "common_drop_growth", rows)


def write(folder, name, rows):
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, f"{name}.csv"), "w", newline="", encoding="ascii") as file:
        table = csv.DictWriter(file, rows[0].keys())
        table.writeheader()
        table.writerows(rows)


def plot_drop(folder, n, rows):
    try:
        import matplotlib
    except ImportError:
        print("no plot: matplotlib is not installed", file=sys.stderr)
        return
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.5))
    for program in dict.fromkeys(row["program"] for row in rows):
        own = [row for row in rows if row["program"] == program]
        points = [(row["cpu_seconds"], 100 * max(row["overlap_peak"], 1e-6)) for row in own]
        axes.plot(*zip(*points), "o-" if len(own) > 1 else "o", label=program)
    axes.set(xscale="log", yscale="log", xlabel="processor seconds", ylabel="largest overlap, % of the radius")
    axes.set_title(f"{(2 * n + 1) ** 3} spheres, 2 s, one thread")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(os.path.join(folder, f"common_drop_{n}.svg"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=4, help="the lattice has 2n+1 spheres along each edge")
    parser.add_argument("--peers", help="names with commas; all that are installed otherwise; 'none' for none")
    parser.add_argument("--growth", metavar="N,N", help="measure growth at these n instead")
    parser.add_argument("--program", default=os.path.join(ROOT, "target", "release", "graintrain"), help="graintrain itself")
    parser.add_argument("--out", default="common_drop", help="folder for the CSV and the plot")
    arguments = parser.parse_args()
    if arguments.peers == "none":
        PEERS.clear()
        arguments.peers = ""
    unknown = [name for name in (arguments.peers or "").split(",") if name and name not in PEERS]
    if unknown:
        parser.error(f"unknown peer {unknown[0]}; there are {', '.join(PEERS)}")
    if not os.path.exists(arguments.program):
        parser.error(f"{arguments.program} is not there: cargo build --release, or --program FILE")
    grow(arguments) if arguments.growth else compare(arguments)


if __name__ == "__main__":
    main()
