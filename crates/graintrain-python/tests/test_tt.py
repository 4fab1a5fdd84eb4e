"""The functions of graintrain.tt against full arrays, closed forms and SciPy."""

from __future__ import annotations

import inspect
import pickle
import signal
import threading
import time

import numpy as np
import pytest

from graintrain import TrainError, TrainMatrix, TrainVector, tt
from graintrain.tt import qtt

rng = np.random.default_rng(5)


def flat(train: TrainVector) -> np.ndarray:
    return train.to_numpy().ravel(order="F")


def dense(train: TrainMatrix) -> np.ndarray:
    return train.to_numpy()


def test_everything_is_documented_and_exported():
    for module in (tt, qtt):
        for name in module.__all__:
            thing = getattr(module, name)
            assert inspect.getdoc(thing), name
            if inspect.isclass(thing) and not issubclass(thing, Exception):
                for member, value in vars(thing).items():
                    if not member.startswith("_"):
                        assert inspect.getdoc(value), f"{name}.{member}"


def test_vectors_are_made_in_every_way(tmp_path):
    factors = [rng.normal(size=n) for n in (2, 3, 4)]
    outer = np.einsum("i,j,k->ijk", *factors)
    x = TrainVector.rank_one(factors)
    np.testing.assert_allclose(x.to_numpy(), outer, atol=1e-14)
    assert (x.num_cores, x.max_rank, x.num_entries) == (3, 1, 24.0)
    np.testing.assert_array_equal(TrainVector.from_cores(x.cores).to_numpy(), x.to_numpy())
    unit = TrainVector.unit([2, 3], [1, 2]).to_numpy()
    assert unit[1, 2] == 1 and unit.sum() == 1
    random = TrainVector.random([4, 4, 4], 3, seed=7)
    assert random.ranks == [1, 3, 3, 1]
    np.testing.assert_array_equal(random.to_numpy(), TrainVector.random([4, 4, 4], 3, seed=7).to_numpy())
    y, report = TrainVector.from_numpy(outer + 1e-3 * rng.normal(size=outer.shape), 0.0, max_rank=1, return_report=True)
    error = np.linalg.norm(y.to_numpy() - outer) / np.linalg.norm(outer)
    assert report["capped"] and y.max_rank == 1 and error < 0.1 and report["error"] > 0
    random.save_hdf5(tmp_path / "x.h5")
    for other in (TrainVector.load_hdf5(tmp_path / "x.h5"), pickle.loads(pickle.dumps(random))):
        np.testing.assert_array_equal(other.to_numpy(), random.to_numpy())
    tt.write_sdv(random, tmp_path / "x.sdv")
    np.testing.assert_array_equal(tt.read_sdv(tmp_path / "x.sdv").to_numpy(), random.to_numpy())


def test_entries_parts_and_modes_are_those_of_numpy():
    x = TrainVector.random([3, 2, 4, 2], 3)
    full = x.to_numpy()
    places = np.stack([rng.integers(0, n, 20) for n in full.shape], axis=1)
    np.testing.assert_allclose(x.entries(places), full[tuple(places.T)], atol=1e-13)
    part = x.sub_tensor([slice(1, 3), 1, slice(None), slice(0, 1)])
    np.testing.assert_allclose(part.to_numpy(), full[1:3, 1:2, :, 0:1], atol=1e-13)
    np.testing.assert_allclose(part.squeeze().to_numpy(), full[1:3, 1, :, 0], atol=1e-13)
    np.testing.assert_allclose(x.sum_over([False, True, False, True]).to_numpy(), full.sum(axis=(1, 3)), atol=1e-12)
    np.testing.assert_allclose(x.merge_modes([2, 2]).to_numpy(), full.reshape(6, 8, order="F"), atol=1e-13)
    matrix = rng.normal(size=(5, 4))
    np.testing.assert_allclose(x.mode_product(2, matrix).to_numpy(), np.einsum("aj,kljm->klam", matrix, full), atol=1e-12)
    twice = x.concatenate(x * 2.0, 1).to_numpy()
    np.testing.assert_allclose(twice, np.concatenate([full, 2 * full], axis=1), atol=1e-12)
    turned, report = x.permute([2, 0, 3, 1])
    np.testing.assert_allclose(turned.to_numpy(), full.transpose(2, 0, 3, 1), atol=1e-9)
    assert report["error"] <= 1e-10
    np.testing.assert_allclose(x.reverse().to_numpy(), full.transpose(3, 2, 1, 0), atol=1e-13)
    y = TrainVector.random([2, 3], 2)
    np.testing.assert_allclose(x.kronecker(y).to_numpy(), np.multiply.outer(full, y.to_numpy()), atol=1e-12)


def test_norms_roundings_and_distances():
    x = TrainVector.random([2] * 8, 4)
    full = x.to_numpy()
    assert x.log_norm() == pytest.approx(np.log(np.linalg.norm(full)))
    for k, s in enumerate(x.singular_values()):
        unfolding = full.reshape(2 ** (k + 1), -1, order="F")
        np.testing.assert_allclose(s, np.linalg.svd(unfolding, compute_uv=False)[: len(s)], atol=1e-12)
    for turned in (x.orthogonalise_left(), x.orthogonalise_right()):
        assert turned.relative_distance(x) < 1e-13
    left = x.orthogonalise_left().cores[0].reshape(-1, x.ranks[1], order="F")
    np.testing.assert_allclose(left.T @ left, np.eye(x.ranks[1]), atol=1e-13)
    y, report = x.round(0.3, return_report=True)
    assert y.relative_distance(x) == pytest.approx(report["error"], rel=1e-8) and report["error"] <= 0.3
    error, floor = (x * (1 + 1e-9)).measured_distance(x)
    assert error == pytest.approx(1e-9, rel=1e-3) and floor < 1e-12 and 0 < x.rounding_floor() < 1e-12
    doubled = x + x
    assert doubled.without_dependent_ranks().ranks == x.ranks
    np.testing.assert_allclose((-doubled).to_numpy(), -2 * full, atol=1e-12)
    for total, report in (
        TrainVector.sum_rounded([(2.0, x), (-1.0, y)]),
        TrainVector.sum_sketched([(2.0, x), (-1.0, y)], 1e-8),
    ):
        np.testing.assert_allclose(total.to_numpy(), 2 * full - y.to_numpy(), atol=1e-6)
    power, _ = qtt.ramp(6, 0.0, 0.01).entrywise_power(5, 1e-13)
    np.testing.assert_allclose(flat(power), (0.01 * np.arange(64)) ** 5, atol=1e-11)


def test_functions_of_entries():
    x = qtt.ramp(10, 1.0, 0.01)
    line = 1.0 + 0.01 * np.arange(1024)
    y, report = x.reciprocal(1e-10)
    assert report["status"] == "Converged"
    np.testing.assert_allclose(flat(y), 1 / line, rtol=1e-7)
    root, report = x.square_root(1e-10, seed=3)
    assert report["converged"] and report["residual"] <= 1e-10
    np.testing.assert_allclose(flat(root), np.sqrt(line), rtol=1e-7)
    mixed, report = tt.map(lambda a, b: np.exp(-a) * b, [x, root], 1e-9)
    assert report["status"] == "Converged"
    np.testing.assert_allclose(flat(mixed), np.exp(-line) * np.sqrt(line), atol=1e-7)
    with pytest.raises(TrainError, match="trains of a function"):
        tt.map(lambda: 0.0, [])
    with pytest.raises(TrainError, match="mode sizes"):
        tt.map(lambda a, b: a, [x, qtt.ramp(9)])
    with pytest.raises(ZeroDivisionError):
        tt.map(lambda a: 1 / 0, [x])


def test_extremes_and_samples():
    wave = qtt.sine(12, 0.01)
    found = wave.extremes()
    values = np.sin(0.01 * np.arange(4096))
    assert found["largest"]["proven"] and found["largest"]["value"] == pytest.approx(values.max(), abs=1e-12)
    assert qtt.index(found["smallest"]["index"], [2] * 12) == values.argmin()
    density = TrainVector.from_numpy(np.array([[1.0, 2.0], [3.0, 4.0]]))
    samples = density.sample(20_000, "Entries", seed=4)
    counts = np.zeros((2, 2))
    np.add.at(counts, tuple(samples.T), 1)
    np.testing.assert_allclose(counts / 20_000, np.array([[0.1, 0.2], [0.3, 0.4]]), atol=0.015)
    squares = density.sample(20_000)
    assert squares.shape == (20_000, 2) and (squares == 1).all(axis=1).mean() == pytest.approx(16 / 30, abs=0.02)


def test_matrices_are_made_and_read(tmp_path):
    factors = [rng.normal(size=(2, 3)), rng.normal(size=(3, 2))]
    a = TrainMatrix.rank_one(factors)
    full = np.kron(factors[1], factors[0])
    np.testing.assert_allclose(dense(a), full, atol=1e-14)
    assert (a.rows, a.columns, a.num_rows, a.num_columns, a.num_cores, a.max_rank) == ([2, 3], [3, 2], 6, 6, 2, 1)
    assert a.entry([1, 2], [0, 1]) == pytest.approx(full[5, 3])
    np.testing.assert_allclose(a.entries([[5, 3], [0, 0]]), full[[5, 0], [3, 0]])
    np.testing.assert_array_equal(dense(TrainMatrix.from_vector(a.as_vector(), [2, 3], [3, 2])), dense(a))
    np.testing.assert_array_equal(dense(TrainMatrix.from_cores(a.cores, [2, 3], [3, 2])), dense(a))
    np.testing.assert_array_equal(dense(pickle.loads(pickle.dumps(a))), dense(a))
    a.save(tmp_path / "a.tt")
    a.save_hdf5(tmp_path / "a.h5")
    for other in (TrainMatrix.load(tmp_path / "a.tt"), TrainMatrix.load_hdf5(tmp_path / "a.h5")):
        np.testing.assert_array_equal(dense(other), dense(a))
    b = TrainMatrix.random([2] * 4, [2] * 4, 3)
    full = dense(b)
    np.testing.assert_allclose(flat(b.diagonal()), np.diag(full))
    assert b.trace() == pytest.approx(np.trace(full)) and b.norm() == pytest.approx(np.linalg.norm(full))
    np.testing.assert_allclose(dense(b.symmetric_part()), (full + full.T) / 2, atol=1e-13)
    np.testing.assert_allclose(dense(b.hadamard(b)), full**2, atol=1e-12)
    np.testing.assert_allclose(dense(b - 2.0 * b), -full, atol=1e-12)
    np.testing.assert_allclose(dense(-b), -full)
    np.testing.assert_allclose(dense(TrainMatrix.from_diagonal(b.diagonal())), np.diag(np.diag(full)))
    np.testing.assert_allclose(dense(b.kronecker(b)), np.kron(full, full), atol=1e-12)
    block = b.sub_matrix([slice(None)] * 3 + [1], [slice(None)] * 3 + [0])
    np.testing.assert_allclose(dense(block), full[8:, :8], atol=1e-13)
    assert (b + b).without_dependent_ranks().ranks == b.ranks
    rounded, report = b.round(0.2, return_report=True)
    assert rounded.relative_distance(b) == pytest.approx(report["error"], rel=1e-8)
    x = TrainVector.random([2] * 4, 2)
    product, report = b.times_vector_rounded(x)
    np.testing.assert_allclose(flat(product), full @ flat(x), atol=1e-9)
    square, report = b.times_matrix_rounded(b, 1e-12)
    np.testing.assert_allclose(dense(square), full @ full, atol=1e-9)


def test_quantized_trains_are_the_formulas():
    n, j = 64, np.arange(64)
    second = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    np.testing.assert_allclose(dense(qtt.laplacian(6)), second, atol=1e-14)
    second[0, 0] = 1
    np.testing.assert_allclose(dense(qtt.laplacian_with(6, "Neumann", "dirichlet")), second, atol=1e-14)
    three = 3 * np.eye(n, k=-1) + 4 * np.eye(n) + 5 * np.eye(n, k=1)
    np.testing.assert_allclose(dense(qtt.tridiagonal(6, 3, 4, 5)), three, atol=1e-14)
    np.testing.assert_allclose(dense(qtt.shift(6)), np.eye(n, k=-1))
    np.testing.assert_allclose(dense(qtt.periodic_shift(6)), np.roll(np.eye(n), 1, axis=0))
    np.testing.assert_allclose(dense(qtt.cumulative_sum(6)), np.tril(np.ones((n, n))))
    hilbert = 1 / (j[:, None] + j + 1)
    np.testing.assert_allclose(dense(qtt.hilbert_matrix(6)), hilbert, atol=1e-9)
    np.testing.assert_allclose(qtt.hilbert([n, n]).to_numpy(), hilbert, atol=1e-9)
    np.testing.assert_allclose(flat(qtt.exponential(6, -0.1, 0.3)), np.exp(0.3 - 0.1 * j))
    np.testing.assert_allclose(flat(qtt.sine(6, 0.2, 0.3)), np.sin(0.2 * j + 0.3), atol=1e-14)
    np.testing.assert_allclose(flat(qtt.polynomial(6, [1, 0, 2], 0.5, 0.1)), 1 + 2 * (0.5 + 0.1 * j) ** 2)
    np.testing.assert_allclose(flat(qtt.ramp(6, 1.0, 0.5)), 1 + 0.5 * j)
    np.testing.assert_array_equal(flat(qtt.step(6, 13)), j >= 13)
    x = rng.normal(size=n)
    train = TrainVector.from_numpy(x, 1e-14, modes=[2] * 6)
    np.testing.assert_allclose(dense(qtt.circulant(train)), x[(j[:, None] - j) % n], atol=1e-12)
    half = np.arange(32)
    np.testing.assert_allclose(dense(qtt.toeplitz(train)), x[(half[:, None] - half) % n], atol=1e-12)
    line = qtt.laplacian(3)
    flat_line = dense(line)
    plane = np.kron(np.eye(8), flat_line) + np.kron(flat_line, np.eye(8))
    np.testing.assert_allclose(dense(qtt.kronecker_sum([line, line])), plane, atol=1e-13)
    order = [qtt.morton([i % 8, i // 8], 3) for i in range(64)]
    morton = dense(qtt.kronecker_sum([line, line], "Morton"))
    np.testing.assert_allclose(morton[np.ix_(order, order)], plane, atol=1e-13)
    both = dense(qtt.interleave([line, line]))
    np.testing.assert_allclose(both[np.ix_(order, order)], np.kron(flat_line, flat_line), atol=1e-12)
    assert qtt.digits(11, [3, 2, 2]) == [2, 1, 1] and qtt.index([2, 1, 1], [3, 2, 2]) == 11
    assert qtt.morton_coordinates(qtt.morton([1, 3], 2), 2, 2) == [1, 3]


def test_systems_are_solved_in_every_way():
    a = qtt.laplacian(7)
    full, n = dense(a), 128
    y = TrainVector.constant([2] * 7, 1.0)
    exact = np.linalg.solve(full, np.ones(n))
    for method in ("Amen", "Dmrg"):
        x, report = a.solve(y, 1e-10, method=method, kick_rank=3)
        assert report["status"] == "Converged" and tt.measured_residual(a, x, y)[0] <= 1e-10
        np.testing.assert_allclose(flat(x), exact, rtol=1e-6)
    identity = TrainMatrix.identity([2] * 7)
    inverse, report = tt.inverse(a, tolerance=1e-9)
    assert report["status"] == "Converged" and inverse.max_rank == 5
    np.testing.assert_allclose(dense(inverse), np.linalg.inv(full), atol=1e-5)
    assert tt.inverse_residual(a, inverse) == pytest.approx(report["residual"], rel=1e-3)
    same, report = tt.solve_matrix(a, identity, 1e-9, start=inverse)
    assert same.relative_distance(inverse) < 1e-6
    better, report = tt.newton_schulz(a, inverse.round(1e-4), 1e-12, stop=1e-7)
    assert report["converged"] and tt.inverse_residual(a, better) * np.sqrt(n) <= 1e-7
    # A preconditioner that is the inverse: one or two iterations.
    x, report = tt.gmres(a, y, 1e-8, preconditioner=inverse)
    assert report["status"] == "Converged" and report["iterations"] <= 3
    x, report = tt.gmres(identity - 0.5 * qtt.shift(7), y, 1e-8, restart=20)
    np.testing.assert_allclose(flat(x), 2 - 0.5 ** np.arange(n), atol=1e-5)
    for form in ("Residual", "Galerkin", "Symmetric"):
        small = identity + 0.2 * qtt.laplacian(7)
        _, report = tt.inverse(small, form, 1e-6)
        assert report["status"] == "Converged", form


def test_eigenpairs_and_evolution():
    linalg = pytest.importorskip("scipy.linalg")
    a = qtt.laplacian(7)
    pairs = tt.lowest_eigenpairs(a, 3, method="Dmrg")
    exact = np.linalg.eigvalsh(dense(a))[:3]
    for (value, vector, report), energy in zip(pairs, exact):
        assert report["converged"] and value == pytest.approx(energy, abs=1e-9) and vector.norm() == pytest.approx(1)
        np.testing.assert_allclose(dense(a) @ flat(vector), value * flat(vector), atol=1e-6)
    x = qtt.sine(7, 0.3)
    y, report = tt.evolve(a * -1.0, x, 0.8, 1e-9, steps=20)
    error = np.linalg.norm(flat(y) - linalg.expm(-0.8 * dense(a)) @ flat(x))
    assert error <= report["error"] < 1e-2
    assert tt.evolve(a, x, 0.0, sites="One")[0].relative_distance(x) < 1e-12


def test_fourier_and_convolutions():
    x, y = rng.normal(size=64), rng.normal(size=64)
    trains = [TrainVector.from_numpy(z, 1e-14, modes=[2] * 6) for z in (x, y)]
    real, imaginary, report = tt.fourier(*trains)
    spectrum = np.fft.fft(x + 1j * y) / 8
    np.testing.assert_allclose(flat(real) + 1j * flat(imaginary), spectrum, atol=1e-8)
    real, imaginary, _ = tt.fourier(real, imaginary, "Backward")
    np.testing.assert_allclose(flat(imaginary), y, atol=1e-8)
    z, report = tt.convolution(*trains)
    np.testing.assert_allclose(flat(z)[:127], np.convolve(x, y), atol=1e-7)


def test_complex_trains():
    full = rng.normal(size=(2, 2, 2, 2)) + 1j * rng.normal(size=(2, 2, 2, 2))
    x, report = tt.ComplexVector.from_numpy(full)
    assert report["error"] <= 1e-10 and x.modes == [2] * 4 and x[1, 0, 1, 1] == pytest.approx(full[1, 0, 1, 1])
    np.testing.assert_allclose(x.to_numpy(), full, atol=1e-12)
    np.testing.assert_allclose(x.real.to_numpy() + 1j * x.imaginary.to_numpy(), full, atol=1e-12)
    again = tt.ComplexVector(x.real, x.imaginary)
    np.testing.assert_allclose(((2 + 1j) * again - x).to_numpy(), (1 + 1j) * full, atol=1e-11)
    assert x.norm() == pytest.approx(np.linalg.norm(full)) and x.ranks[-1] == 1
    y = tt.ComplexVector.rank_one([[1, 1j], [2, 1 - 1j], [1, 1], [0.5j, 1]])
    other = np.einsum("i,j,k,l->ijkl", [1, 1j], [2, 1 - 1j], [1, 1], [0.5j, 1])
    np.testing.assert_allclose(y.to_numpy(), other, atol=1e-14)
    assert x.dot(y) == pytest.approx(np.vdot(full, other))
    np.testing.assert_allclose(x.hadamard(y.conjugate()).to_numpy(), full * other.conj(), atol=1e-11)
    np.testing.assert_allclose((x + y).round()[0].to_numpy(), full + other, atol=1e-8)
    np.testing.assert_allclose(tt.ComplexVector.from_parts(y.as_parts()).to_numpy(), other, atol=1e-14)
    turned = x.fourier()[0].to_numpy().ravel(order="F")
    np.testing.assert_allclose(turned, np.fft.fft(full.ravel(order="F")) / 4, atol=1e-8)
    a, b = qtt.laplacian(4), qtt.shift(4)
    matrix = tt.ComplexMatrix(a, b)
    numbers = dense(a) + 1j * dense(b)
    right = tt.ComplexVector.from_real(TrainVector.constant([2] * 4, 1.0))
    solution, report = matrix.solve(right, 1e-10)
    assert report["status"] == "Converged"
    np.testing.assert_allclose(solution.to_numpy().ravel(order="F"), np.linalg.solve(numbers, np.ones(16)), rtol=1e-6)
    np.testing.assert_allclose((matrix @ x).to_numpy().ravel(order="F"), numbers @ full.ravel(order="F"), atol=1e-11)
    assert (matrix @ matrix).as_parts().relative_distance(matrix.times_matrix(matrix).as_parts()) < 1e-12
    product = matrix.adjoint().times_matrix(matrix).times_vector(x).to_numpy().ravel(order="F")
    np.testing.assert_allclose(product, numbers.conj().T @ numbers @ full.ravel(order="F"), atol=1e-10)
    assert matrix.as_parts().num_rows == 32


def test_sparse_matrices_and_operators():
    sparse = pytest.importorskip("scipy.sparse")
    random = sparse.random(60, 60, 0.05, random_state=3)
    symmetric = (random + random.T + 20 * sparse.eye(60)).tocsr()
    full = np.zeros((64, 64))
    full[:60, :60] = symmetric.toarray()
    tree = tt.QuadtreeMatrix.from_sparse(symmetric)
    assert (tree.leaf_size, tree.levels, tree.modes, tree.num_entries) == (4, 4, [4, 2, 2, 2, 2], symmetric.nnz)
    assert tree.norm() == pytest.approx(np.linalg.norm(full)) == tree.augmented_norm()
    positions, values = tree.entries()
    np.testing.assert_array_equal(full[tuple(positions.T)], values)
    again = tt.QuadtreeMatrix.from_entries(4, 4, positions, values)
    assert again.entry(int(positions[5, 0]), int(positions[5, 1])) == values[5]
    train, report = tree.to_train(1e-3)
    error = np.linalg.norm(dense(train) - full) / np.linalg.norm(full)
    assert error == pytest.approx(report["error"], rel=1e-3) == pytest.approx(tree.relative_error(train), rel=1e-3)
    definite, report = tt.QuadtreeMatrix.from_sparse(sparse.eye(64) * 2.0).to_definite_train(1.0, 1e-6)
    assert report["shift"] == 0.0 and report["smallest"]["value"] == pytest.approx(2.0)
    found, report = tt.cross_sparse(tree, 1e-3)
    assert report["exact_error"] is None or report["exact_error"] == pytest.approx(
        np.linalg.norm(dense(found) - full) / np.linalg.norm(full), rel=1e-3
    )
    blocks = tt.QuadtreeMatrix.from_blocks([[0, 0], [1, 1]], np.stack([np.eye(3)] * 2), [0, 1], 2, 1, dummy=1.0)
    np.testing.assert_allclose(dense(blocks.to_train()[0]), np.eye(12), atol=1e-9)
    graded = tt.SymmetricTrain.symmetric_part(train)
    assert graded.modes == train.rows and graded.ranks[0] == (1, 0) and graded.num_parameters > 0
    halves = (graded * 0.5 + graded * 0.5).round(1e-12)[0]
    assert halves.to_matrix().relative_distance(train) < 1e-10
    x = TrainVector.random([4, 2, 2, 2, 2], 2)
    np.testing.assert_allclose(flat(graded.times_vector(x)), dense(train) @ flat(x), atol=1e-9)
    operator = tt.FullOperator(train)
    columns = rng.normal(size=(64, 3))
    np.testing.assert_allclose(operator.apply(columns), dense(train) @ columns, atol=1e-11)
    np.testing.assert_allclose(operator.apply(columns[:, 0]), dense(train) @ columns[:, 0], atol=1e-11)
    assert (operator.num_rows, operator.num_columns) == (64, 64) and operator.flops > 0 and operator.traffic > 0
    smallest, largest = tt.FullOperator(qtt.laplacian(6)).extreme_eigenvalues(64)
    energies = np.linalg.eigvalsh(dense(qtt.laplacian(6)))
    assert smallest["value"] == pytest.approx(energies[0], abs=1e-9) and largest["value"] == pytest.approx(energies[-1])
    sketch = tt.Sketch(train.as_vector().modes, 60)
    sketch.add_sparse(tree)
    other = tt.Sketch(train.as_vector().modes, 60)
    other.add_train(train.as_vector() * -1.0)
    other.add_entries(np.zeros((1, 5), int), [1.0])
    sketch.add(other)
    rest = full - dense(train)
    rest[0, 0] += 1.0
    sum_of_all = TrainMatrix.from_vector(sketch.to_train(1e-10)[0], train.rows, train.columns)
    np.testing.assert_allclose(dense(sum_of_all), rest, atol=1e-6)


def test_fits_probes_and_volumes():
    places = rng.integers(0, 10, size=(3000, 4))
    x, report = tt.fit([10] * 4, places, 1 / (20.0 + places.sum(axis=1)), 1e-2, max_rank=4)
    assert report["converged"] and x[3, 1, 4, 1] == pytest.approx(1 / 29, abs=1e-3)
    assert tt.sub_grid([5, 2], 6).tolist() == [[0, 0], [2, 0], [4, 0], [0, 1], [2, 1], [4, 1]]
    ends = tt.ends_of_modes([8] * 3)
    x, report = tt.cross(lambda i: 1.0 / (1 + i.sum(axis=1)), [8] * 3, 1e-8, probes=ends, kick_rank=2, seed=2)
    assert report["probe_error"] <= 1e-8
    matrix = rng.normal(size=(40, 5))
    rows, coordinates = tt.maxvol(matrix)
    np.testing.assert_allclose(coordinates @ matrix[rows], matrix, atol=1e-11)
    assert np.abs(coordinates).max() <= 1.06


def test_toolbox_files(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    x = TrainVector.random([2, 3, 2], 2)
    cores = x.cores
    numbers = np.concatenate([core.ravel(order="F") for core in cores])
    starts = np.cumsum([1] + [core.size for core in cores])
    scipy_io.savemat(
        tmp_path / "x.mat",
        {"x": {"d": 3.0, "n": np.array([[2.0], [3], [2]]), "r": np.array([[float(r)] for r in x.ranks]), "core": numbers[:, None], "ps": starts[:, None] * 1.0, "over": 0.0}},
    )
    found = tt.read_mat(tmp_path / "x.mat")
    np.testing.assert_allclose(found["x"].to_numpy(), x.to_numpy())


def test_a_heisenberg_chain_in_two_lines():
    chain = tt.OperatorSum([2] * 10)
    for weight, a, b in [(0.5, "S+", "S-"), (0.5, "S-", "S+"), (1.0, "Sz", "Sz")]:
        chain.add_translates(weight, [a, b])
    h = chain.to_matrix()
    assert chain.num_terms == 27 and chain.modes == [2] * 10 and h.max_rank == 5
    energies = np.linalg.eigvalsh(dense(h))
    (value, _, report), *_ = tt.lowest_eigenpairs(h)
    assert report["converged"] and value == pytest.approx(energies[0], abs=1e-9) == pytest.approx(-4.258035207, abs=1e-8)
    # The same by Kronecker products; S_y is imaginary, i S_y is real.
    full = np.zeros((2**6, 2**6))
    spins = [tt.local_operator(name, 2) for name in ("Sx", "iSy", "Sz")]
    shorter = tt.OperatorSum([2] * 6)
    for k in range(5):
        for spin, sign in zip(spins, (1, -1, 1)):
            shorter.add(sign, [(k, spin), (k + 1, spin)])
            full += sign * np.kron(np.eye(2 ** (4 - k)), np.kron(np.kron(spin, spin), np.eye(2**k)))
    assert shorter.to_matrix().max_rank == 5
    np.testing.assert_allclose(dense(shorter.to_matrix()), full, atol=1e-14)
    quanta = tt.local_operator("A+", 4) @ tt.local_operator("A", 4)
    np.testing.assert_allclose(quanta, tt.local_operator("N", 4), atol=1e-14)


@pytest.mark.parametrize("order", ["Morton", "Separated"])
@pytest.mark.parametrize("points", ["Midpoints", "Ends", "Periodic"])
def test_functions_on_grids_come_back(order, points):
    grid = tt.Grid({"x": (0.0, 1.0, 4), "y": (-1.0, 2.0, 3)}, order, points)
    assert (grid.order, grid.kind, grid.modes) == (order, points, [2] * 7)
    assert grid.axes == {"x": (0.0, 1.0, 4), "y": (-1.0, 2.0, 3)}
    x, y = grid.coordinates("x"), grid.coordinates("y")
    values = np.exp(-x)[:, None] * y + x[:, None]
    f, report = grid.from_numpy(values)
    np.testing.assert_allclose(f.to_numpy(), values, atol=1e-9)
    np.testing.assert_allclose(f(x[:, None], y), values, atol=1e-9)
    np.testing.assert_allclose(f(y=y, x=x[2]), values[2], atol=1e-9)
    places = grid.nearest([[x[3], y[5]]])
    np.testing.assert_allclose(grid.points(places), [[x[3], y[5]]])
    assert f.train.entries(places)[0] == pytest.approx(values[3, 5], abs=1e-9)
    np.testing.assert_allclose(f.restrict("x", x[7]).to_numpy(), values[7], atol=1e-9)
    np.testing.assert_allclose(grid.function(f.train * 2.0).values([[x[1], y[1]]]), 2 * values[1, 1], atol=1e-9)
    assert f.grid.axes == grid.axes
    if points == "Ends":
        trapezoid = getattr(np, "trapezoid", None) or np.trapz
        np.testing.assert_allclose(f.integrate("y").to_numpy(), trapezoid(values, y, axis=1), atol=1e-9)


def test_integrals_of_functions_of_three_variables():
    grid = tt.Grid({"x": (0, 1, 20), "y": (0, 1, 20), "z": (0, np.pi, 20)})
    f, report = grid.cross(lambda x, y, z: np.exp(-x * y) * np.sin(z), 1e-9)
    assert report["status"] == "Converged"
    # 2 integral exp(-x y) over the square: 2 * 0.7965995992970531.
    assert f.integral() == pytest.approx(2 * 0.7965995992970531, abs=1e-7)
    assert f.integrate("z")(0.3, 0.7) == pytest.approx(2 * np.exp(-0.21), abs=1e-7)
    assert f.integrate("x", "z")(y=0.5) == pytest.approx(4 * (1 - np.exp(-0.5)), abs=1e-7)
    with pytest.raises(LookupError):
        grid.cross(lambda x, y, z: {}["nothing"])
    peak, _ = tt.Grid({"x": (0, 1, 20)}).cross(lambda x: np.exp(-(((x - 0.3) / 1e-4) ** 2)), probes=[[0.3]])
    assert peak.integral() == pytest.approx(np.sqrt(np.pi) * 1e-4, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: TrainVector.from_cores([np.ones((2, 2))]), ValueError, r"cores\[0\] has 2 dimensions"),
        (lambda: TrainVector.from_cores([]), ValueError, "number of cores"),
        (lambda: TrainVector.from_cores([np.ones((1, 2, 3))]), ValueError, "right rank"),
        (lambda: TrainVector.rank_one([[]]), ValueError, "numbers in a core"),
        (lambda: TrainVector.random([2] * 40, 10**9), ValueError, "does not fit"),
        (lambda: TrainVector.constant([2] * 40, 1.0).to_numpy(), ValueError, "does not fit"),
        (lambda: TrainVector.constant([2], np.nan).round(), ValueError, "not a number"),
        (lambda: TrainVector.constant([2, 2], 1.0).entries([[0, 2]]), ValueError, "outside 0..2"),
        (lambda: TrainVector.constant([2, 2], 1.0).entries([[0, -1]]), ValueError, "index -1"),
        (lambda: TrainVector.constant([2, 2], 1.0).entries([[0.5, 1]]), TypeError, "expected integers"),
        (lambda: TrainVector.constant([2, 2], 1.0).entries([0, 1]), ValueError, r"expected \(n, 2\)"),
        (lambda: TrainVector.constant([2, 2], 1.0).sub_tensor([slice(0, 2, 2), 0]), ValueError, "step 2"),
        (lambda: TrainVector.constant([2, 2], 1.0).sub_tensor([0]), ValueError, "1 ranges, expected 2"),
        (lambda: TrainVector.constant([2, 2], 1.0).sub_tensor([0, slice(1, 1)]), ValueError, "none empty"),
        (lambda: TrainVector.constant([2, 2], 1.0).permute([0, 0]), ValueError, "order of modes"),
        (lambda: TrainVector.constant([2, 2], 1.0).mode_product(0, [1.0]), ValueError, "shape"),
        (lambda: TrainVector.constant([2, 2], 1.0).sample(3, "Cubes"), ValueError, "density: unknown variant"),
        (lambda: TrainVector.constant([2, 2], 0.0).sample(3), ValueError, "norm of a density"),
        (lambda: TrainVector.sum_rounded([]), ValueError, "terms of a sum"),
        (lambda: TrainMatrix.rank_one([np.ones(3)]), ValueError, r"factors\[0\] has the shape"),
        (lambda: TrainMatrix.random([2], [2, 2], 1), ValueError, "mode sizes|rows"),
        (lambda: TrainMatrix.identity([2]).entries([[0, 5]]), ValueError, "outside"),
        (lambda: qtt.laplacian(1), ValueError, "at least 2"),
        (lambda: qtt.laplacian(10**12), ValueError, "digits, expected at most"),
        (lambda: qtt.laplacian_with(4, "Robin", "Neumann"), ValueError, "first: unknown variant"),
        (lambda: qtt.index([2], [2]), ValueError, "lies outside"),
        (lambda: qtt.kronecker_sum([]), ValueError, "number of axes"),
        (lambda: qtt.interleave([]), ValueError, "digits per axis"),
        (lambda: qtt.toeplitz(TrainVector.constant([3], 1.0)), ValueError, "vector of differences"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(4), speed=3), TypeError, "'speed'; settings are"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(4), max_sweeps=-1), ValueError, "max_sweeps: invalid value"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(4), method="Sor"), ValueError, "method: unknown variant"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(4), np.nan), ValueError, "tolerance is NaN"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(4), seed=[]), TypeError, "seed: expected a number"),
        (lambda: qtt.laplacian(4).solve(qtt.ramp(5)), ValueError, "modes of a right-hand side"),
        (lambda: tt.inverse(qtt.laplacian(4), "Best"), ValueError, "form: unknown variant"),
        (lambda: tt.inverse(qtt.laplacian(4) * 0.0), ValueError, "norm of a matrix to invert"),
        (lambda: tt.gmres(qtt.laplacian(4), qtt.ramp(4), restart=0), ValueError, "restart must be in"),
        (lambda: tt.gmres(qtt.laplacian(4), qtt.ramp(4), restart=10**15), ValueError, "restart must be in"),
        (lambda: tt.lowest_eigenpairs(qtt.laplacian(30), 10**12), ValueError, "number of eigenpairs"),
        (lambda: tt.evolve(qtt.laplacian(4), qtt.ramp(4) * 0.0, 1.0, steps=10**15), ValueError, "steps must be in"),
        (lambda: tt.lowest_eigenpairs(qtt.shift(4)), ValueError, "at most 1e-10"),
        (lambda: tt.evolve(qtt.laplacian(4), qtt.ramp(4), np.inf), ValueError, "time must be finite"),
        (lambda: tt.evolve(qtt.laplacian(4), qtt.ramp(4), 1.0, steps=0), ValueError, "steps"),
        (lambda: tt.fourier(TrainVector.constant([3], 1.0)), ValueError, "modes of a Fourier"),
        (lambda: tt.fourier(qtt.ramp(4), None, "Sideways"), ValueError, "direction"),
        (lambda: tt.fit([2, 2], [[0, 0]], [1.0]), ValueError, "at least 10 values"),
        (lambda: tt.maxvol(np.ones((3, 2))), ValueError, "singular"),
        (lambda: tt.cross(lambda i: i[:, 0], [2, 2], probes=[[0, 5]]), ValueError, "outside"),
        (lambda: tt.sub_grid([], 3), ValueError, "modes"),
        (lambda: tt.read_mat("/no/such/file.mat"), ValueError, "No such file"),
        (lambda: tt.ComplexVector.from_numpy([]), ValueError, "entries|modes|numbers"),
        (lambda: tt.QuadtreeMatrix.from_entries(2, 1, [[0, 9]], [1.0]), ValueError, "outside"),
        (lambda: tt.QuadtreeMatrix.from_entries(2, 90, [[0, 0]], [1.0]), ValueError, "levels"),
        (lambda: tt.QuadtreeMatrix.from_sparse(np.eye(4)).to_definite_train(-1.0), ValueError, "floor"),
        (lambda: tt.Sketch([2] * 60, 10**9), ValueError, "does not fit"),
        (lambda: tt.FullOperator(qtt.laplacian(3)).apply(np.ones((4, 2))), ValueError, r"expected \(8,\)"),
        (lambda: tt.FullOperator(qtt.laplacian(3)).apply(1.0), ValueError, "is a number"),
        (lambda: tt.FullOperator(qtt.laplacian(40)).apply([1.0]), ValueError, "shape|does not fit"),
        (lambda: tt.OperatorSum([]), ValueError, "sizes of sites"),
        (lambda: tt.OperatorSum([2]).add(1.0, [(1, "Sz")]), ValueError, "site 1 of 1"),
        (lambda: tt.OperatorSum([2]).add(np.nan, []), ValueError, "finite"),
        (lambda: tt.OperatorSum([2]).add(1.0, [(0, np.ones((3, 3)))]), ValueError, "operator at a site"),
        (lambda: tt.OperatorSum([2]).add(1.0, [(0, "Sq")]), ValueError, "unknown variant"),
        (lambda: tt.OperatorSum([2]).add_translates(1.0, ["Sz", "Sz"]), ValueError, "neighbouring"),
        (lambda: tt.local_operator("Sz", 0), ValueError, "size of a site"),
        (lambda: tt.Grid({}), ValueError, "digits of a grid"),
        (lambda: tt.Grid({"x": (1, 0, 3)}), ValueError, 'axis "x": the interval'),
        (lambda: tt.Grid({"x": (0, 1)}), TypeError, "expected .low, high, bits."),
        (lambda: tt.Grid({"x": (0, 1, 99)}), ValueError, "99 bits"),
        (lambda: tt.Grid({"x": (0, 1, 3)}, points="Corners"), ValueError, "points: unknown variant"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).coordinates("y"), ValueError, "there is none; axes are x"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).cross(lambda x: x / 0.0 * 0.0), ValueError, "entry"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).from_numpy(np.ones(8))[0](2.0), ValueError, "lies outside"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).from_numpy(np.ones(8))[0](0.5, 0.5), TypeError, "2 coordinates, expected 1"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).from_numpy(np.ones(8))[0](y=0.5), TypeError, "no coordinate"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).from_numpy(np.ones(8))[0].integrate("x"), ValueError, "no axis is left"),
        (lambda: tt.Grid({"x": (0, 1, 3)}).from_numpy(np.ones(7)), ValueError, "shape"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*encountered in.*")
def test_what_is_wrong_is_said(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_ctrl_c_ends_a_long_solve():
    # A random system of high rank: without the signal it takes far longer than the test may.
    a = TrainMatrix.identity([4] * 12) * 4.0 + TrainMatrix.random([4] * 12, [4] * 12, 6, seed=2) * 1e-3
    y = TrainVector.random([4] * 12, 12, seed=3)
    threading.Timer(0.5, lambda: signal.raise_signal(signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(1000):
            a.solve(y, 1e-12, max_rank=150, kick_rank=20)
    assert time.monotonic() - began < 20


def test_other_threads_run_meanwhile():
    ticks = 0

    def count():
        nonlocal ticks
        while not done.is_set():
            ticks += 1
            time.sleep(1e-3)

    done = threading.Event()
    thread = threading.Thread(target=count)
    thread.start()
    tt.lowest_eigenpairs(qtt.kronecker_sum([qtt.laplacian(5)] * 2), 3)
    done.set()
    thread.join()
    assert ticks > 10
