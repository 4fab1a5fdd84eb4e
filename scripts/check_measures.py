#!/usr/bin/env python3
"""Recomputes measurements of a run from its frames, and compares them with the tables in measures/.

    scripts/check_measures.py DIR [--tolerance 1e-9]

Needs Python 3.11 and nothing else. The run has to be of spheres between walls without spheres, with frames in double precision
(`[output] precision = "double"`) of bodies and contacts. Checked are stress, coordination, fabric, forces, motion, force, plane (the force through it), mixing,
profile and histogram, at every frame that has a record. Written from the definitions in docs/measurements.md, not from the program.
Exit code 1 and one line per difference; at the end how many numbers were compared.
"""
import argparse
import base64
import csv
import json
import math
import pathlib
import struct
import sys
import tomllib
import xml.etree.ElementTree as ElementTree

FORMATS = {"Float64": ("d", 8), "Float32": ("f", 4), "Int64": ("q", 8), "Int32": ("i", 4), "UInt8": ("B", 1)}


def read_vtp(path):
    """Arrays of a frame by name; vectors as lists of three."""
    arrays = {}
    for element in ElementTree.parse(path).getroot().iter("DataArray"):
        letter, size = FORMATS[element.get("type")]
        text = (element.text or "").strip()
        if element.get("format") == "ascii":
            numbers = [float(word) for word in text.split()]
        else:
            raw = base64.b64decode(text) if text else b"\0" * 8
            (count,) = struct.unpack("<Q", raw[:8])
            numbers = list(struct.unpack(f"<{count // size}{letter}", raw[8 : 8 + count]))
        width = int(element.get("NumberOfComponents") or 1)
        if width > 1:
            numbers = [numbers[k : k + width] for k in range(0, len(numbers), width)]
        arrays[element.get("Name")] = numbers
    return arrays


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Frame:
    def __init__(self, folder, step, dt):
        bodies = read_vtp(folder / "frames" / f"bodies_{step:08}.vtp")
        self.place = dict(zip(bodies["body"], bodies["Points"]))
        for name in ("radius", "mass", "v", "omega"):
            setattr(self, name, dict(zip(bodies["body"], bodies[name])))
        # Where the bodies were when the contacts were found: the arms of forces reach from there.
        self.start = {b: [x - dt * v for x, v in zip(self.place[b], self.v[b])] for b in self.place}
        lines = read_vtp(folder / "frames" / f"contacts_{step:08}.vtp")
        points = lines.get("Points", [])
        self.contacts = []
        normal = [dot(f, n) for f, n in zip(lines["force"], lines["n"])]
        threshold = max(1e-6 * sum(normal) / max(len(normal), 1), 0.0)
        for k, (a, b) in enumerate(zip(lines["id1"], lines["id2"])):
            force, n = lines["force"][k], lines["n"][k]
            tangential = math.sqrt(max(dot(force, force) - normal[k] ** 2, 0.0))
            self.contacts.append(
                {
                    "bodies": (a, b),
                    "point": points[3 * k + 1],
                    "force": force,
                    "n": n,
                    "normal": normal[k],
                    "loaded": normal[k] > threshold,
                    "sliding": lines["mu"][k] == 0.0 or tangential >= 0.999 * lines["mu"][k] * normal[k],
                }
            )


def inside(region, point):
    if region is None:
        return True
    if "box" in region:
        low, high = region["box"]["min"], region["box"]["max"]
        return all(l <= x <= h for l, x, h in zip(low, point, high))
    c = region["cylinder"]
    d = minus(point, c["base"])
    return math.hypot(d[0], d[1]) <= c["radius"] and 0.0 <= d[2] <= c["height"]


def volume(region, frame, meant):
    if region is None:
        edges = [
            max(frame.place[b][k] + frame.radius[b] for b in meant) - min(frame.place[b][k] - frame.radius[b] for b in meant)
            for k in range(3)
        ]
        return math.prod(edges)
    if "box" in region:
        return math.prod(minus(region["box"]["max"], region["box"]["min"]))
    return math.pi * region["cylinder"]["radius"] ** 2 * region["cylinder"]["height"]


def stress(frame, meant, spec):
    space = volume(spec.get("region"), frame, meant)
    tensor = [[0.0] * 3 for _ in range(3)]
    for contact in frame.contacts:
        for body, sign in zip(contact["bodies"], (1.0, -1.0)):
            if body in meant:
                branch = minus(frame.start[body], contact["point"])
                for i in range(3):
                    for j in range(3):
                        tensor[i][j] += sign * branch[i] * contact["force"][j] / space
    mass = sum(frame.mass[b] for b in meant)
    mean = [sum(frame.mass[b] * frame.v[b][k] for b in meant) / mass for k in range(3)]
    deviations = ((frame.mass[b], minus(frame.v[b], mean)) for b in meant)
    found = {f"stress_{'xyz'[i]}{'xyz'[j]}": tensor[i][j] for i in range(3) for j in range(3)}
    found["pressure"] = sum(tensor[k][k] for k in range(3)) / 3
    found["kinetic_pressure"] = sum(m * dot(c, c) for m, c in deviations) / (3 * space)
    found["volume"] = space
    return found


def coordination(frame, meant, spec):
    neighbours = {body: set() for body in frame.place}
    loaded = [c for c in frame.contacts if c["loaded"]]
    for contact in loaded:
        a, b = contact["bodies"]
        for one, other in ((a, b), (b, a)):
            if one in neighbours:
                neighbours[one].add(other)
    rattlers = set()
    while True:
        held = {b: sum(o not in rattlers for o in neighbours[b]) for b in neighbours if b not in rattlers}
        more = {b for b, count in held.items() if count < spec["rattlers_below"]}
        if not more:
            break
        rattlers |= more
    mine = [c for c in loaded if any(b in meant for b in c["bodies"])]
    kept = [b for b in meant if b not in rattlers]
    return {
        "bodies": len(meant),
        "contacts": len(mine),
        "coordination": sum(len(neighbours[b]) for b in meant) / len(meant) if meant else 0.0,
        "rattlers": sum(b in rattlers for b in meant),
        "coordination_without_rattlers": sum(held[b] for b in kept) / len(kept) if kept else 0.0,
        "sliding": sum(c["sliding"] for c in mine) / len(mine) if mine else 0.0,
    }


def mine(frame, meant):
    return [c for c in frame.contacts if c["loaded"] and any(b in meant for b in c["bodies"])]


def fabric(frame, meant, spec):
    normals = [c["n"] for c in mine(frame, meant)]
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz")
    mean = lambda i, j: sum(n[i] * n[j] for n in normals) / len(normals) if normals else math.nan
    return {f"fabric_{p}": mean("xyz".index(p[0]), "xyz".index(p[1])) for p in pairs}


def forces(frame, meant, spec):
    f = [c["normal"] for c in mine(frame, meant)]
    if not f:
        return {"force_count": 0}
    mean = sum(f) / len(f)
    return {
        "force_count": len(f),
        "force_mean": mean,
        "force_deviation": math.sqrt(sum((x - mean) ** 2 for x in f) / len(f)),
        "force_max": max(f),
        "force_strong": sum(x > mean for x in f) / len(f),
    }


def motion(frame, meant, spec):
    mass = sum(frame.mass[b] for b in meant)
    found = {"count": len(meant), "mass": mass}
    for k, axis in enumerate("xyz"):
        found[f"centre_{axis}"] = sum(frame.mass[b] * frame.place[b][k] for b in meant) / mass
        found[f"velocity_{axis}"] = sum(frame.mass[b] * frame.v[b][k] for b in meant) / mass
    return found


def force(frame, meant, spec, numbers):
    bodies = {numbers[name] for name in spec["force"]["bodies"]}
    total, torque = [0.0] * 3, [0.0] * 3
    for contact in frame.contacts:
        a, b = contact["bodies"]
        if (a in bodies) == (b in bodies) or not inside(spec.get("region"), contact["point"]):
            continue
        f = [x if a in bodies else -x for x in contact["force"]]
        total = [x + y for x, y in zip(total, f)]
        turn = cross(minus(contact["point"], spec["force"]["point"]), f)
        torque = [x + y for x, y in zip(torque, turn)]
    return {f"{name}_{axis}": v[k] for name, v in (("force", total), ("torque", torque)) for k, axis in enumerate("xyz")}


def through(frame, meant, spec):
    point, normal = spec["plane"]["point"], spec["plane"]["normal"]
    total = [0.0] * 3
    for contact in frame.contacts:
        ends = [frame.place.get(body, contact["point"]) for body in contact["bodies"]]
        high = [dot(normal, minus(end, point)) for end in ends]
        if (high[0] < 0) == (high[1] < 0):
            continue
        share = high[1] / (high[1] - high[0])
        at = [b + share * (a - b) for a, b in zip(*ends)]
        if inside(spec.get("region"), at):
            sign = 1.0 if high[0] >= 0 else -1.0
            total = [x + sign * y for x, y in zip(total, contact["force"])]
    return {f"through_{axis}": total[k] for k, axis in enumerate("xyz")}


def cap(radius, z):
    h = min(max(z + radius, 0.0), 2 * radius)
    return math.pi * h * h * (radius - h / 3)


def profile(frame, meant, spec):
    bins = spec["profile"]
    if bins["along"] == "radius":
        return []
    axis, count = "xyz".index(bins["along"]), bins["bins"]
    width = (bins["to"] - bins["from"]) / count
    rows = []
    for k in range(count):
        low, high = bins["from"] + k * width, bins["from"] + (k + 1) * width
        shares = []
        for b in meant:
            x, r = frame.place[b][axis], frame.radius[b]
            shares.append((b, (cap(r, high - x) - cap(r, low - x)) / cap(r, r)))
        mass = sum(s * frame.mass[b] for b, s in shares)
        row = {"bin": k, "bodies": sum(s for _, s in shares)}
        if mass > 0:
            mean = [sum(s * frame.mass[b] * frame.v[b][i] for b, s in shares) / mass for i in range(3)]
            squares = sum(s * frame.mass[b] * dot(minus(frame.v[b], mean), minus(frame.v[b], mean)) for b, s in shares)
            row |= {f"velocity_{a}": mean[i] for i, a in enumerate("xyz")} | {"temperature": squares / mass / 3}
        region = spec.get("region")
        if region and "box" in region:
            edges = minus(region["box"]["max"], region["box"]["min"])
            common = min(high, region["box"]["max"][axis]) - max(low, region["box"]["min"][axis])
            if common > 0:
                row["density"] = mass / (common * edges[(axis + 1) % 3] * edges[(axis + 2) % 3])
        rows.append(row)
    return rows


def histogram(frame, meant, spec):
    f = [c["normal"] for c in mine(frame, meant)]
    count, most = spec["histogram"]["bins"], spec["histogram"]["most"]
    width, mean = most / count, sum(f) / max(len(f), 1)
    density = [0.0] * count
    for x in f:
        if x / mean < most:
            density[int(x / mean / width)] += 1 / (len(f) * width)
    return [{"bin": k, "probability_density": p} for k, p in enumerate(density)]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=pathlib.Path)
    arguments.add_argument("--tolerance", type=float, default=1e-9)
    arguments = arguments.parse_args()
    folder = arguments.folder
    scene = tomllib.loads((folder / "scene.toml").read_text())
    columns = json.loads((folder / "columns.json").read_text())
    numbers = {name: k for k, name in enumerate(scene.get("body", {}))}
    frames = sorted(int(path.stem.split("_")[1]) for path in (folder / "frames").glob("contacts_*.vtp"))
    dt = scene["time"]["step"]
    frames = {step: Frame(folder, step, dt) for step in frames if step > 0}
    compared, wrong = 0, 0
    for name, spec in scene.get("measure", {}).items():
        if spec.get("bodies") or spec.get("packings"):
            continue
        with open(folder / "measures" / f"{name}.csv", newline="") as file:
            records = list(csv.DictReader(file))
        expected = [column["name"] for column in columns[f"measures/{name}.csv"]]
        if records and list(records[0]) != expected:
            print(f"{name}: the header is not that of columns.json")
            wrong += 1
        for step, frame in frames.items():
            rows = [record for record in records if int(record["step"]) == step]
            meant = {b for b in frame.place if inside(spec.get("region"), frame.place[b])}
            if not rows or not meant:
                continue
            found = {}
            for quantity in (stress, coordination, fabric, forces, motion):
                if spec.get(quantity.__name__):
                    found |= quantity(frame, meant, spec)
            found |= force(frame, meant, spec, numbers) if "force" in spec else {}
            found |= through(frame, meant, spec) if "plane" in spec else {}
            table = [found]
            if "profile" in spec:
                table = profile(frame, meant, spec)
            if "histogram" in spec:
                table = histogram(frame, meant, spec)
            for mine_row, row in zip(table, rows):
                scale = {}
                for column, value in mine_row.items():
                    group = column.rsplit("_", 1)[0]
                    scale[group] = max(scale.get(group, 0.0), abs(value))
                for column, value in mine_row.items():
                    compared += 1
                    theirs = float(row[column]) if row[column] else math.nan
                    if math.isnan(theirs) and math.isnan(value):
                        continue
                    if not abs(theirs - value) <= arguments.tolerance * max(scale[column.rsplit("_", 1)[0]], 1e-12):
                        print(f"{name}, step {step}: {column} is {theirs!r} in the table, {value!r} from the frame")
                        wrong += 1
    print(f"{compared} numbers compared, {wrong} differ")
    sys.exit(1 if wrong or not compared else 0)


if __name__ == "__main__":
    main()
