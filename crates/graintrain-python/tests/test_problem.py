"""Contact problems from arrays and files."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain
from conftest import ball_pile
from graintrain import Problem


def one_ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A ball of 2 kg on a floor, thrown down at 1 m/s and along it at 0.1 m/s: N = diag(1, 3.5, 3.5) / 2 kg."""
    return np.diag([0.5, 1.75, 1.75]), np.array([-1.0, 0.1, 0.0]), np.array([0.3])


def bodies(count: int = 6, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Balls in a row: D, the diagonal of M^-1, r, mu."""
    rng = np.random.default_rng(seed)
    radius = 0.1
    d = np.zeros((6 * count, 3 * (count - 1)))
    frame = np.eye(3)
    for k in range(count - 1):
        for body, sign in [(k, 1.0), (k + 1, -1.0)]:
            # The normal points from body k + 1 to body k, along -x; the arm from the centre to the contact.
            axes = np.array([-frame[0], frame[1], -frame[2]])
            arm = np.array([radius * sign, 0, 0])
            for row, axis in enumerate(axes):
                d[6 * body : 6 * body + 3, 3 * k + row] = sign * axis
                d[6 * body + 3 : 6 * body + 6, 3 * k + row] = sign * np.cross(arm, axis)
    mass = rng.uniform(1, 3, count)
    inverse = np.repeat(1.0 / mass, 6)
    inverse.reshape(-1, 6)[:, 3:] = (1.0 / (0.4 * mass * radius**2))[:, None]
    return d, inverse, d.T @ rng.normal(0, 1, 6 * count), rng.uniform(0.1, 0.6, count - 1)


def test_a_ball_on_a_floor():
    w, q, mu = one_ball()
    for friction in ["relaxed", "coulomb"]:
        problem = Problem.from_matrix(w, q, mu)
        impulse, report = problem.solve("ipm", tolerance=1e-10, friction=friction)
        assert report.converged and report.solver.startswith("ipm")
        assert impulse.shape == (1, 3)
        if friction == "coulomb":
            np.testing.assert_allclose(impulse[0], [2.0, -0.1 / 1.75, 0.0], atol=1e-8)
        assert problem.residual(impulse, friction)[0] < 1e-9
        assert problem.residual(impulse.ravel() * 1.01, friction)[0] > 1e-3


def test_arrays_sparse_matrices_and_bodies_are_one_problem():
    sparse = pytest.importorskip("scipy.sparse")
    d, inverse, r, mu = bodies()
    w = d.T @ (inverse[:, None] * d)
    blocks = np.array([np.diag(x) for x in inverse.reshape(-1, 6)])
    problems = [
        Problem.from_matrix(w, r, mu),
        Problem.from_matrix(sparse.csr_array(w), r.reshape(-1, 3), list(mu)),
        Problem.from_bodies(d, inverse, r, mu),
        Problem.from_bodies(sparse.csc_matrix(d), blocks, r, mu),
        Problem.from_bodies(d, sparse.diags(inverse), r, mu),
    ]
    assert [problem.form for problem in problems] == ["local"] * 2 + ["rigid-bodies"] * 3
    answers = [problem.solve("ipm", tolerance=1e-11)[0] for problem in problems]
    for problem, answer in zip(problems, answers):
        np.testing.assert_allclose(answer, answers[0], atol=1e-8)
        row, column, value = problem.matrix()
        np.testing.assert_allclose(sparse.coo_array((value, (row, column)), shape=w.shape).toarray(), w, atol=1e-12)
        np.testing.assert_array_equal(problem.friction, mu)
        np.testing.assert_allclose(problem.r.ravel(), r, atol=1e-14)
    # The optimality conditions, written out with NumPy alone.
    g = answers[0]
    u = (w @ g.ravel() + r).reshape(-1, 3)
    assert (np.hypot(g[:, 1], g[:, 2]) <= mu * g[:, 0] + 1e-8).all()
    assert (u[:, 0] >= mu * np.hypot(u[:, 1], u[:, 2]) - 1e-7).all()
    assert abs((g * u).sum()) < 1e-7
    found = problems[2].evaluate(g)
    np.testing.assert_allclose(found["velocities"], u, atol=1e-10)
    assert found["apart"] + found["sticking"] + found["sliding"] == len(problems[2]) == 5
    assert problems[2].bodies == 6


def test_bodies_that_do_not_move():
    d, inverse, r, mu = bodies()
    inverse[:6] = 0.0
    w = d.T @ (inverse[:, None] * d)
    held, free = Problem.from_bodies(d, inverse, r, mu), Problem.from_matrix(w, r, mu)
    np.testing.assert_allclose(held.solve("ipm", tolerance=1e-11)[0], free.solve("ipm", tolerance=1e-11)[0], atol=1e-8)


def test_every_solver_agrees_or_says_that_it_did_not_converge():
    w, q, mu = one_ball()
    problem = Problem.from_bodies(*bodies())
    reference = problem.solve("ipm", tolerance=1e-11)[0]
    converged = 0
    for solver, about in graintrain.solvers().items():
        assert about
        impulse, report = problem.solve(solver, tolerance=1e-7, max_seconds=5)
        if report.converged:
            converged += 1
            np.testing.assert_allclose(impulse, reference, atol=1e-4, err_msg=solver)
        history = report.history
        assert history.shape[1] == 4 and len(history) > 0, solver
        assert report.to_dict()["iterations"] == report.iterations
    assert converged >= 6
    _, early = problem.solve("pgs", tolerance=1e-12, max_iterations=1)
    assert not early.converged and early.status == "iteration-limit" and early.residual[0] > 1e-12


def test_files_and_the_problem_of_a_step(tmp_path):
    world = ball_pile(3)
    with pytest.raises(graintrain.ProblemError, match="no step"):
        world.problem
    world.run(0.3)
    problem, impulse = world.problem
    assert impulse.shape == (len(problem), 3) and problem.residual(impulse, "coulomb")[1] <= 1e-4
    file = tmp_path / "step.hdf5"
    problem.dump(file, "a pile")
    read = Problem.from_file(file)
    assert read.title == "a pile" and len(read) == len(problem) and read.velocity_scale == pytest.approx(9.81 * 2e-3)
    assert read.residual(impulse) == pytest.approx(problem.residual(impulse))
    again, report = read.solve(start=impulse)
    assert report.converged and again.shape == impulse.shape
    text = tmp_path / "problem.dat"
    text.write_text("no problem")
    with pytest.raises(graintrain.ProblemError, match="problem.dat"):
        Problem.from_file(text)
    with pytest.raises(OSError, match="missing"):
        Problem.from_file(tmp_path / "missing.dat")


def test_a_problem_of_siconos(tmp_path):
    # Contacts, W row by row, q, mu: the text form of Siconos' local problems.
    w, q, mu = one_ball()
    numbers = [" ".join(map(str, row)) for row in w]
    file = tmp_path / "siconos.dat"
    file.write_text("\n".join(["3", "1", "0", "3 3", "3 3", *numbers, " ".join(map(str, q)), str(mu[0]), ""]))
    problem = Problem.from_file(file)
    assert problem.form == "local" and len(problem) == 1
    np.testing.assert_array_equal(problem.r[0], q)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda w, q, mu: Problem.from_matrix(w[:2], q, mu), ValueError, "3"),
        (lambda w, q, mu: Problem.from_matrix(w, q[:2], mu), ValueError, "q has 2 numbers, expected 3"),
        (lambda w, q, mu: Problem.from_matrix(w, q, [0.1, 0.2]), ValueError, "mu has 2 numbers, expected 1"),
        (lambda w, q, mu: Problem.from_matrix(w, q, -mu), graintrain.ProblemError, "negative"),
        (lambda w, q, mu: Problem.from_matrix(w, q * np.nan, mu), graintrain.ProblemError, "q"),
        (lambda w, q, mu: Problem.from_matrix(w[0], q, mu), ValueError, "two dimensions"),
        (lambda w, q, mu: Problem.from_bodies(np.eye(6, 3), np.ones(5), q, mu), ValueError, "inverse_mass"),
        (lambda w, q, mu: Problem.from_matrix(w, q, mu).solve("best"), graintrain.ProblemError, "known solvers"),
        (lambda w, q, mu: Problem.from_matrix(w, q, mu).solve(tolerance=0.0), ValueError, "tolerance"),
        (lambda w, q, mu: Problem.from_matrix(w, q, mu).solve(friction="exact"), ValueError, "relaxed or coulomb"),
        (lambda w, q, mu: Problem.from_matrix(w, q, mu).solve(start=[1.0]), ValueError, "start has the shape"),
        (lambda w, q, mu: Problem.from_matrix(w, q, mu).residual([[1.0]]), ValueError, "impulses has the shape"),
    ],
)
def test_messages_name_what_is_wrong(make, error, message):
    with pytest.raises(error, match=message):
        make(*one_ball())
