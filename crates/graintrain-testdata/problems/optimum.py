#!/usr/bin/env python3
"""Optima of the relaxed problems beside this file by Clarabel (pip install clarabel numpy scipy h5py), for reference.csv.

    crates/graintrain-testdata/problems/optimum.py > crates/graintrain-testdata/problems/reference.csv

Each problem min 1/2 v'M v, D'v + r in the dual cones, is solved in the scaled velocities L'v, M = L L', with r of unit length, and measured by
the largest relative row of g - P(g - u) in the metric of the diagonal of N. How the problems were made:

    graintrain run SCENE --steps K --dump-problem every=K
    sedimentation-1: sedimentation n=1, 40   sedimentation-2: n=2, 60   drafting-1: n=1, 60   direct-shear-1: n=1, 60
    stack: 50   incline: 20   press: press.toml, 60   mixed-falling, mixed-resting: mixed.toml, 120 and 200
    mass-ratio-1e6: two boxes, the upper one 1e6 times denser, 3
    sed125.dat: 125 spheres settled by a penalty code, one step of 25 ms
"""
import os
import sys

import clarabel
import h5py
import numpy as np
import scipy.sparse as sp

FOLDER = os.path.dirname(os.path.abspath(__file__))


def matrix(group):
    """A compressed or triplet matrix of FCLIB."""
    rows, columns, kind = (int(group[key][0]) for key in ("m", "n", "nz"))
    p, i, x = (group[key][()] for key in "pix")
    if kind >= 0:
        return sp.coo_matrix((x[:kind], (i[:kind], p[:kind])), shape=(rows, columns)).tocsc()
    form = sp.csc_matrix if kind == -1 else sp.csr_matrix
    return form((x[: p[-1]], i[: p[-1]], p), shape=(rows, columns)).tocsc()


def read_fclib(path):
    """M, D, r and mu of a global problem M v = D g + f, u = D'v + w."""
    with h5py.File(path) as file:
        group = file["fclib_global"]
        mass, d = matrix(group["M"]), matrix(group["H"])
        r = group["vectors/w"][()] + d.T @ np.linalg.solve(mass.toarray(), group["vectors/f"][()])
        return mass, d, r, group["vectors/mu"][()]


def read_siconos(path):
    """The same of a global Siconos text problem whose matrices are printed by CSparse as triplets."""
    lines = open(path).read().splitlines()
    contacts, position = int(lines[1]), 5

    def sparse():
        nonlocal position
        while not lines[position].startswith("triplet"):
            position += 1
        rows, columns = (int(size) for size in lines[position].split()[1].rstrip(",").split("-by-"))
        entries = []
        position += 1
        while ":" in lines[position]:
            place, value = lines[position].split(":")
            entries.append((*map(int, place.split()), float(value)))
            position += 1
        i, j, x = zip(*entries)
        return sp.coo_matrix((x, (i, j)), shape=(rows, columns)).tocsc()

    mass, d = sparse(), sparse()
    rest = np.array(" ".join(lines[position:]).split(), dtype=float)
    f, w, mu = np.split(rest, [d.shape[0], d.shape[0] + 3 * contacts])
    mu = mu[:contacts]
    return mass, d, w + d.T @ np.linalg.solve(mass.toarray(), f), mu


def project(x, mu):
    """Rows of x on the cones |x_t| <= mu x_n."""
    n, t, y = x[:, 0], np.hypot(x[:, 1], x[:, 2]), x.copy()
    along = np.maximum(0.0, (n + mu * t) / (1.0 + mu * mu))
    out = t > mu * n
    y[out, 0] = along[out]
    y[out, 1:] *= (mu * along / np.maximum(t, 1e-300))[out, None]
    return y


def solve(mass, d, r, mu):
    """Objective and error."""
    scale = np.linalg.norm(r)
    scaled = sp.csc_matrix(np.linalg.solve(np.linalg.cholesky(mass.toarray()), d.toarray()))
    weight = np.ones(len(r))
    weight[1::3] = weight[2::3] = mu
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    size = scaled.shape[0]
    cones = [clarabel.SecondOrderConeT(3)] * len(mu)
    rows = -(sp.diags(weight) @ scaled.T).tocsc()
    solver = clarabel.DefaultSolver(sp.eye(size, format="csc"), np.zeros(size), rows, weight * r / scale, cones, settings)
    g = weight * np.array(solver.solve().z)
    n = (scaled.T @ scaled).tocsc()
    u = (n @ g + r / scale).reshape(-1, 3)
    eta = n.diagonal().reshape(-1, 3).mean(axis=1)
    defect = g.reshape(-1, 3) - project(g.reshape(-1, 3) - u / eta[:, None], mu)
    error = (eta * np.linalg.norm(defect, axis=1)).max() / np.sqrt(np.mean((r / scale) ** 2) * 3)
    return scale**2 * (0.5 * g @ (n @ g) + g @ r / scale), error


def main():
    print("problem,contacts,mu_min,mu_max,objective,error")
    for name in sorted(os.listdir(FOLDER)):
        path = os.path.join(FOLDER, name)
        if name.endswith(".hdf5"):
            problem = read_fclib(path)
        elif name.endswith(".dat"):
            problem = read_siconos(path)
        else:
            continue
        objective, error = solve(*problem)
        mu = problem[3]
        print(f"{name},{len(mu)},{mu.min():g},{mu.max():g},{objective:.12e},{error:.1e}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
