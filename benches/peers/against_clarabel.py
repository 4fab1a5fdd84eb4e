#!/usr/bin/env python3
"""graintrain beside Clarabel (pip install clarabel numpy scipy) on contact problems, by turns in one run, one thread.

The Python package of Clarabel brings its fast factorisation (faer), which the crate does not have by default. It gets
the problem in three forms:
  velocity  min 1/2 v'M v                    subject to D'v + r in the dual cones
  scaled    the same in x = M^(1/2) v, and r of unit length
  impulse   min 1/2 g'N g + r'g              subject to g in the cones, N = D'M^-1 D
Every answer is measured by the natural map of graintrain, written out here once more. Times are processor seconds: of
Clarabel from the matrices in memory to the answer, of graintrain the same (the `cpu_seconds` of `solve --json`).

Usage: benches/peers/against_clarabel.py TOLERANCE SOLVERS FORMS ROUNDS PROBLEM...
  benches/peers/against_clarabel.py 1e-8 ipm,apgd velocity,scaled 3 data/ccp/sed729 data/ccp/sed4913
PROBLEM.npz holds D, the diagonal of M^-1, r and mu; PROBLEM.dat the same as a Siconos text problem.
"""
import json
import os
import subprocess
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"
import clarabel  # noqa: E402  (the number of threads comes first)
import numpy as np  # noqa: E402
import scipy.sparse as sp  # noqa: E402

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")


def project(x, mu):
    """Rows of x on the cones |x_t| <= mu x_n."""
    n, t, y = x[:, 0], np.hypot(x[:, 1], x[:, 2]), x.copy()
    along = np.maximum(0.0, (n + mu * t) / (1.0 + mu * mu))
    out = t > mu * n
    y[out, 0] = along[out]
    y[out, 1:] *= (mu * along / np.maximum(t, 1e-300))[out, None]
    return y


class Problem:
    def __init__(self, path):
        data = np.load(path)
        self.d = sp.csc_matrix((data["D_data"], data["D_indices"], data["D_indptr"]), shape=data["D_shape"])
        self.inverse_mass, self.r, self.mu = data["Minv"], data["p"], data["mu"]
        self.n = (self.d.T @ sp.diags(self.inverse_mass) @ self.d).tocsc()
        self.eta = self.n.diagonal().reshape(-1, 3).mean(axis=1)
        self.scale = np.sqrt(np.mean((self.r.reshape(-1, 3) ** 2).sum(axis=1)))

    def residual(self, g):
        """Largest row of eta (g - P(g - u / eta)) over V, the root mean square of r."""
        u = (self.n @ g + self.r).reshape(-1, 3)
        g = g.reshape(-1, 3)
        d = np.linalg.norm(g - project(g - u / self.eta[:, None], self.mu), axis=1)
        return (self.eta * d).max() / self.scale


def run_clarabel(problem, form, tolerance):
    """Processor seconds, iterations, status and impulses."""
    contacts, weight = len(problem.mu), np.ones(len(problem.r))
    if form == "impulse":
        weight[0::3] = problem.mu
        p, q = sp.triu(problem.n).tocsc(), problem.r
        a, b = -sp.diags(weight).tocsc(), np.zeros(len(problem.r))
    else:
        weight[1::3] = weight[2::3] = problem.mu
        unit = np.linalg.norm(problem.r) if form == "scaled" else 1.0
        root = np.sqrt(problem.inverse_mass) if form == "scaled" else np.ones(len(problem.inverse_mass))
        p, q = sp.diags(root**2 / problem.inverse_mass).tocsc(), np.zeros(len(root))
        a = -(sp.diags(weight) @ problem.d.T @ sp.diags(root)).tocsc()
        b = weight * problem.r / unit
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.max_threads = 1
    start = time.process_time()
    solution = clarabel.DefaultSolver(p, q, a, b, [clarabel.SecondOrderConeT(3)] * contacts, settings).solve()
    seconds = time.process_time() - start
    g = np.array(solution.x) if form == "impulse" else unit * weight * np.array(solution.z)
    return seconds, solution.iterations, str(solution.status), g


def run_graintrain(program, path, solver, tolerance, folder):
    answer = os.path.join(folder, "answer.csv")
    command = [program, "solve", path, "--solver", solver, "--tolerance", str(tolerance), "--threads", "1"]
    text = subprocess.run(command + ["--json", "--solution", answer], capture_output=True, check=True).stdout
    record = json.loads(text)
    g = np.loadtxt(answer, delimiter=",", skiprows=1, usecols=(1, 2, 3)).ravel()
    return record["cpu_seconds"], record["iterations"], record["status"], g


def main():
    import tempfile

    tolerance, solvers, forms, rounds = float(sys.argv[1]), sys.argv[2].split(","), sys.argv[3].split(","), int(sys.argv[4])
    subprocess.run(["cargo", "build", "--release", "-q", "-p", "graintrain-cli"], cwd=ROOT, check=True)
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
    program = os.path.join(target, "release", "graintrain")
    for path in sys.argv[5:]:
        problem, results = Problem(path + ".npz"), {}
        print(f"{os.path.basename(path)}: {len(problem.mu)} contacts, tolerance {tolerance:g}, best of {rounds} rounds", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(rounds):
                for form in forms:
                    results.setdefault(f"clarabel {form}", []).append(run_clarabel(problem, form, tolerance))
                for solver in solvers:
                    results.setdefault(solver, []).append(
                        run_graintrain(program, path + ".dat", solver, tolerance, folder)
                    )
        fastest = min(run[0] for name, runs in results.items() if name.startswith("clarabel") for run in runs)
        for name, runs in results.items():
            seconds, iterations, status, g = min(runs, key=lambda run: run[0])
            print(
                f"  {name:18} {status:16} {iterations:6} it {seconds:8.3f} s  {seconds / fastest:6.3f} of Clarabel's time"
                f"  residual {problem.residual(g):.1e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
