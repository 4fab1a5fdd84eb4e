"""Which contact solver is best on my problem: all of them on one problem of a pile, to the same accuracy, measured independently."""

import os

import graintrain
from graintrain import plot

n = 3 if os.environ.get("GRAINTRAIN_SMALL") else 4
world = graintrain.World.from_scene("sedimentation", set={"n": n})
world.run(2.0)
problem, _ = world.problem  # or graintrain.Problem.from_file("mine.hdf5"), .from_matrix(W, q, mu), .from_bodies(D, inverse_mass, r, mu)
print(problem)

reports = {}
for name in ["apgd", "pgs", "ipm", "auto"]:
    impulses, report = problem.solve(name, tolerance=1e-6, max_seconds=20)
    reports[name] = report
    worst, _ = problem.residual(impulses)
    print(f"{name:6} {report.status:16} {report.iterations:6} iterations {report.seconds:8.4f} s, residual by another code {worst:.1e}")

done = {name: report for name, report in reports.items() if report.converged}
print("fastest:", min(done, key=lambda name: done[name].seconds))
plot.convergence(reports).figure.savefig("which_solver.png", dpi=120)
