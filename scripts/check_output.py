#!/usr/bin/env python3
"""Reads every frame of a run back with VTK (the library inside ParaView) and OVITO, and checks that they agree.

    pip install vtk ovito
    scripts/check_output.py out/sedimentation [--png picture.png]

Exit code 1 and one line per defect where something does not fit. With --png, OVITO also renders the last frame.
"""
import argparse
import csv
import json
import pathlib
import sys
import xml.etree.ElementTree as ElementTree

import numpy
import vtk
from vtk.util.numpy_support import vtk_to_numpy

defects = []


def expect(condition, what):
    if not condition:
        defects.append(what)
        print("DEFECT", what)


def frames(folder, name):
    """(time, files) of every frame in a .pvd, in the order of the file."""
    listed = {}
    for entry in ElementTree.parse(folder / name).getroot().iter("DataSet"):
        listed.setdefault(float(entry.get("timestep")), []).append(folder / entry.get("file"))
    return sorted(listed.items())


def read_with_vtk(path):
    messages = []
    reader = vtk.vtkXMLPolyDataReader()
    reader.AddObserver("ErrorEvent", lambda *arguments: messages.append(str(arguments)))
    reader.AddObserver("WarningEvent", lambda *arguments: messages.append(str(arguments)))
    reader.SetFileName(str(path))
    reader.Update()
    expect(not messages, f"{path}: VTK complains: {messages}")
    return reader.GetOutput()


def array(attributes, name):
    data = attributes.GetArray(name)
    return None if data is None else vtk_to_numpy(data)


def check_time(data, time, path):
    field = data.GetFieldData().GetArray("TimeValue")
    expect(field is not None and field.GetValue(0) == time, f"{path}: TimeValue is not {time}")


def rotation(quaternions):
    """Matrices of quaternions x y z w."""
    x, y, z, w = quaternions.T
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]).transpose(2, 0, 1)


def check_bodies(folder):
    """Every body frame with VTK, then the whole series with OVITO against it."""
    from ovito.io import import_file

    series = frames(folder, "bodies.pvd")
    pipeline = import_file(str(folder / "bodies.pvd"))
    expect(pipeline.source.num_frames == len(series), "OVITO and bodies.pvd disagree on the number of frames")
    for number, (time, files) in enumerate(series):
        expect(len(files) == 1, f"{time}: OVITO needs one file per frame, there are {len(files)}")
        data = read_with_vtk(files[0])
        points = data.GetNumberOfPoints()
        expect(data.GetNumberOfVerts() == points, f"{files[0]}: {points} points, {data.GetNumberOfVerts()} verts")
        check_time(data, time, files[0])
        position = vtk_to_numpy(data.GetPoints().GetData()) if points else numpy.zeros((0, 3))
        arrays = {name: array(data.GetPointData(), name) for name in
                  ("id", "body", "type", "shapetype", "radius", "mass", "v", "omega", "quat", "f", "tq", "contacts")}
        for name, values in arrays.items():
            expect(values is not None and len(values) == points, f"{files[0]}: array {name} is missing or short")
            expect(numpy.isfinite(values).all(), f"{files[0]}: array {name} has numbers that are not finite")
        expect(len(set(arrays["id"])) == points, f"{files[0]}: identifiers repeat")
        length = numpy.linalg.norm(arrays["quat"], axis=1)
        expect(numpy.allclose(length, 1, atol=1e-6), f"{files[0]}: quaternions are not normalised")

        # With shapes of their own, OVITO's particles have no radius.
        is_turned = data.GetPointData().HasArray("tensor")
        particles = pipeline.compute(number).particles
        expect(particles.count == points, f"OVITO frame {number}: {particles.count} particles, VTK has {points}")
        for theirs, ours in (("Position", position), ("Radius", arrays["radius"] * (not is_turned)), ("Mass", arrays["mass"]),
                             ("Velocity", arrays["v"]), ("Angular Velocity", arrays["omega"]),
                             ("Force", arrays["f"]), ("Torque", arrays["tq"]),
                             ("Particle Identifier", arrays["id"])):
            expect(theirs in particles, f"OVITO frame {number}: no property {theirs}, only {list(particles.keys())}")
            if theirs in particles:
                expect(numpy.allclose(particles[theirs][...], ours, rtol=1e-6, atol=0),
                       f"OVITO frame {number}: {theirs} differs from VTK")
        if is_turned:
            half_axes = numpy.stack([array(data.GetPointData(), f"shape{axis}") for axis in "xyz"], axis=1)
            expect(numpy.allclose(particles["Aspherical Shape"][...], half_axes, rtol=1e-6, atol=0),
                   f"OVITO frame {number}: Aspherical Shape differs from VTK")
            tensor = array(data.GetPointData(), "tensor").reshape(-1, 3, 3).transpose(0, 2, 1)
            expect(numpy.allclose(rotation(particles["Orientation"][...]), tensor, atol=1e-6),
                   f"OVITO frame {number}: Orientation is not the rotation of tensor")
            for name in ("Orientation", "Aspherical Shape"):
                # Arrays of these names without a type are what a user added, and are not drawn.
                expect(particles[name].type_id != 0, f"OVITO frame {number}: {name} is not its own property")
        shown = pipeline.compute(number).attributes.get("Time")
        expect(shown is not None and abs(shown - time) <= 1e-12 * max(1, time), f"OVITO frame {number}: Time is {shown}")
    print(f"bodies    {len(series)} frames, {points} points")


def check_contacts(folder):
    """Every contact frame with VTK."""
    series = frames(folder, "contacts.pvd")
    for time, files in series:
        data = read_with_vtk(files[0])
        cells = data.GetNumberOfLines()
        expect(data.GetNumberOfCells() == cells, f"{files[0]}: cells that are not lines")
        check_time(data, time, files[0])
        arrays = {name: array(data.GetCellData(), name) for name in
                  ("id1", "id2", "force", "fn", "ft", "gap", "n", "sliding", "mu")}
        for name, values in arrays.items():
            expect(values is not None and len(values) == cells, f"{files[0]}: array {name} is missing or short")
        if cells:
            normal = (arrays["force"] * arrays["n"]).sum(axis=1)
            scale = abs(arrays["force"]).max() + 1e-300
            expect(numpy.allclose(normal, arrays["fn"], atol=1e-5 * scale), f"{files[0]}: fn is not force . n")
            cone = arrays["mu"] * arrays["fn"] * 1.001 + 1e-3 * scale
            expect((arrays["ft"] <= cone).all(), f"{files[0]}: a force lies outside its friction cone")
    print(f"contacts  {len(series)} frames, {cells} lines")


def check_surfaces(folder):
    if not (folder / "surfaces.pvd").exists():
        print("surfaces  none")
        return
    series = frames(folder, "surfaces.pvd")
    for time, files in series:
        triangles = 0
        for path in files:
            data = read_with_vtk(path)
            expect(data.GetNumberOfPolys() == data.GetNumberOfCells() > 0, f"{path}: no polygons")
            expect(array(data.GetCellData(), "body_id") is not None, f"{path}: array body_id is missing")
            if len(files) == 1 or not path.name.endswith("fixed.vtp"):
                check_time(data, time, path)
            triangles += data.GetNumberOfPolys()
    print(f"surfaces  {len(series)} frames, {triangles} triangles")


def check_all(folder):
    """The multi-block frames: OVITO and VTK find particles, contacts and meshes together."""
    from ovito.io import import_file

    series = frames(folder, "all.pvd")
    pipeline = import_file(str(folder / "all.pvd"))
    expect(pipeline.source.num_frames == len(series), "OVITO and all.pvd disagree on the number of frames")
    for number, (time, files) in enumerate(series):
        reader = vtk.vtkXMLMultiBlockDataReader()
        reader.SetFileName(str(files[0]))
        reader.Update()
        blocks = {}
        walk = reader.GetOutput().NewTreeIterator()
        walk.InitTraversal()
        while not walk.IsDoneWithTraversal():
            name = walk.GetCurrentMetaData().Get(vtk.vtkCompositeDataSet.NAME())
            blocks[name] = walk.GetCurrentDataObject()
            walk.GoToNextItem()
        found = pipeline.compute(number)
        expect("Particles" in blocks and found.particles.count == blocks["Particles"].GetNumberOfPoints(),
               f"{files[0]}: VTK and OVITO see different particles")
        lines = sum(len(set(numpy.asarray(line["Section"]))) for line in found.lines.values())
        contacts = blocks["Contacts"].GetNumberOfLines() if "Contacts" in blocks else 0
        expect(lines == contacts, f"{files[0]}: OVITO shows {lines} contacts, VTK {contacts}")
        meshes = set(blocks) - {"Particles", "Contacts"}
        expect(set(found.surfaces) == meshes, f"{files[0]}: OVITO shows {set(found.surfaces)}, VTK {meshes}")
    print(f"all       {len(series)} frames, blocks {', '.join(sorted(blocks))}")
    return pipeline


def check_tables(folder):
    with open(folder / "steps.csv", newline="") as file:
        steps = list(csv.DictReader(file))
    summary = json.loads((folder / "summary.json").read_text())
    expect([int(row["step"]) for row in steps] == list(range(1, summary["steps"] + 1)), "steps.csv skips steps")
    columns = json.loads((folder / "columns.json").read_text())
    for name, listed in columns.items():
        if (folder / name).exists():
            with open(folder / name, newline="") as file:
                header = next(csv.reader(file))
            expect(header == [column["name"] for column in listed], f"columns.json and {name} disagree")
            expect(all(column["meaning"] for column in listed), f"columns.json leaves a column of {name} unexplained")
    expect({path.name for path in folder.glob("*.csv")} <= set(columns), "columns.json lacks a table")
    of_newton = {"newton_precompute_seconds", "newton_apply_seconds", "newton_condition", "rank_matrix", "rank_inverse",
                 "compression_error"}
    expect(not any(value in (None, "") for row in steps for name, value in row.items() if name not in of_newton),
           "steps.csv has empty fields")
    expect(steps == [] or float(steps[-1]["time"]) == summary["simulated_seconds"], "the final times differ")
    for column in ["residual", "residual_rms"]:
        worst = max((float(row[column]) for row in steps), default=0)
        found = summary[f"{column}_max"]
        expect(worst == found, f"{column}_max is {found}, steps.csv has {worst}")
    for column, key in (("approach_max", "velocity_error_max"), ("cone_excess", "friction_error_max"),
                        ("slip_angle", "slip_angle_max"), ("overlap_per_step", "overlap_per_step_max_over_radius"),
                        ("penetration_over_size", "penetration_max_over_radius"),
                        ("parts", "parts_max")):
        worst = max((float(row[column]) for row in steps), default=0)
        expect(worst == summary[key], f"{key} is {summary[key]}, steps.csv has {worst}")
    for column, key in (("impacts", "impacts"), ("restitution_lowered", "restitution_lowered"),
                        ("contacts_added", "contacts_added_after_solve"), ("contacts_missed", "contacts_missed")):
        total = sum(int(row[column]) for row in steps)
        expect(total == summary[key], f"{key} is {summary[key]}, steps.csv has {total}")
    total = sum(float(row["correction_energy"]) for row in steps)
    expect(abs(total - summary["correction_energy"]) <= 1e-12 * abs(total), "correction_energy differs from steps.csv")
    work = [float(row["load_work"]) for row in steps]
    expect(abs(sum(work) - summary["load_work"]) <= 1e-12 * sum(map(abs, work)), "load_work differs from steps.csv")
    worst = summary["residual_max"]
    with open(folder / "wrench.csv", newline="") as file:
        records = list(csv.DictReader(file))
    print(f"tables    {len(steps)} steps, {len(records)} wrenches, residual at most {worst:.2e}")


def render(pipeline, picture):
    """A picture of the last frame by OVITO's software renderer: bodies coloured by speed, walls see-through."""
    from ovito.modifiers import ColorCodingModifier, ComputePropertyModifier
    from ovito.vis import TachyonRenderer, Viewport

    last = pipeline.source.num_frames - 1
    pipeline.modifiers.append(ComputePropertyModifier(
        output_property="Speed", expressions=["sqrt(Velocity.X^2 + Velocity.Y^2 + Velocity.Z^2)"]))
    pipeline.modifiers.append(ColorCodingModifier(property="Speed"))
    pipeline.add_to_scene()
    for name, surface in pipeline.compute(last).surfaces.items():
        surface.vis.surface_transparency = 0.8 if name == "fixed" else 0.3
    view = Viewport(type=Viewport.Type.Ortho, camera_dir=(1, 2, -0.7))
    view.zoom_all()
    view.render_image(filename=str(picture), size=(900, 700), frame=last, renderer=TachyonRenderer(shadows=False))
    print(f"picture   {picture}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=pathlib.Path, help="folder of a run")
    arguments.add_argument("--png", type=pathlib.Path, help="render the last frame to this file")
    options = arguments.parse_args()
    check_bodies(options.folder)
    check_contacts(options.folder)
    check_surfaces(options.folder)
    pipeline = check_all(options.folder)
    check_tables(options.folder)
    if options.png:
        render(pipeline, options.png)
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
