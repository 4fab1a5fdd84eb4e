"""Tensor trains against full arrays of NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import graintrain
from graintrain import TrainMatrix, TrainVector

rng = np.random.default_rng(3)


def test_vectors_come_back():
    array = rng.normal(size=(3, 4, 5))
    train = TrainVector.from_numpy(array)
    assert train.modes == [3, 4, 5] and train.ranks[0] == train.ranks[-1] == 1
    np.testing.assert_allclose(train.to_numpy(), array, atol=1e-12)
    assert train[2, 0, 3] == pytest.approx(array[2, 0, 3])
    full = train.cores[0]
    for core in train.cores[1:]:
        full = np.tensordot(full, core, 1)
    np.testing.assert_allclose(full[0, ..., 0], array, atol=1e-12)
    other = rng.normal(size=(3, 4, 5))
    b = TrainVector.from_numpy(other)
    assert train.dot(b) == pytest.approx((array * other).sum())
    assert train.norm() == pytest.approx(np.linalg.norm(array)) and train.sum() == pytest.approx(array.sum())
    np.testing.assert_allclose((train + 2.0 * b - train).to_numpy(), 2 * other, atol=1e-11)
    np.testing.assert_allclose(train.hadamard(b).to_numpy(), array * other, atol=1e-11)


def test_rounding_has_the_error_asked_for(tmp_path):
    x = np.linspace(0, 1, 1024)
    train = TrainVector.from_numpy(np.sqrt(x + 0.01), 1e-14, modes=[2] * 10)
    rounded = train.round(1e-4)
    assert max(rounded.ranks) < max(train.ranks) and rounded.num_parameters < 1024
    error = np.linalg.norm(rounded.to_numpy() - train.to_numpy()) / train.norm()
    assert 1e-9 < error <= 1e-4
    assert max(train.round(0.0, max_rank=2).ranks) == 2
    # Flat vectors have their lowest digit first.
    np.testing.assert_allclose(train.to_numpy().ravel(order="F"), np.sqrt(x + 0.01), rtol=1e-10)
    rounded.save(tmp_path / "x.tt")
    np.testing.assert_array_equal(TrainVector.load(tmp_path / "x.tt").to_numpy(), rounded.to_numpy())


def test_matrices_apply_and_solve():
    sparse = pytest.importorskip("scipy.sparse")
    size = 64
    laplacian = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(size, size)).tocsr()
    full = laplacian.toarray()
    train = TrainMatrix.from_numpy(full)
    same = TrainMatrix.from_sparse(laplacian, leaf=2)
    assert train.rows == [2] * 6 and max(train.ranks) == 3 and same.rows == [2] * 6
    np.testing.assert_allclose(train.to_numpy(), full, atol=1e-12)
    np.testing.assert_allclose(same.to_numpy(), full, atol=1e-9)
    x = rng.normal(size=size)
    np.testing.assert_allclose(train @ x, full @ x, atol=1e-11)
    image = train @ TrainVector.from_numpy(x, modes=[2] * 6)
    np.testing.assert_allclose(image.to_numpy().ravel(order="F"), full @ x, atol=1e-11)
    np.testing.assert_allclose((train @ train).round().to_numpy(), full @ full, atol=1e-9)
    y = TrainVector.constant([2] * 6, 1.0)
    solution, report = train.solve(y, 1e-9)
    assert report["status"] == "Converged" and report["residual"] <= 1e-9
    np.testing.assert_allclose(solution.to_numpy().ravel(order="F"), np.linalg.solve(full, np.ones(size)), rtol=1e-6)
    rectangular = rng.normal(size=(4, 6))
    turned = TrainMatrix.from_numpy(rectangular, rows=[2, 2], columns=[2, 3])
    np.testing.assert_allclose(turned.T.to_numpy(), rectangular.T, atol=1e-12)
    np.testing.assert_allclose((turned + 2.0 * turned).to_numpy(), 3 * rectangular, atol=1e-11)
    np.testing.assert_allclose((TrainMatrix.identity([2] * 6) @ x), x)


def test_cross_reads_some_of_the_entries():
    calls = []

    def function(indices):
        assert indices.dtype == np.int64 and indices.shape[1] == 6
        calls.append(len(indices))
        return 1.0 / (1.0 + indices.sum(axis=1))

    train, report = graintrain.cross(function, [16] * 6, 1e-8)
    assert report["status"] == "Converged" and sum(calls) < 1e-2 * 16**6
    assert train[3, 1, 4, 1, 5, 9] == pytest.approx(1 / 24, rel=1e-6)


def test_what_the_function_of_cross_raises_comes_back():
    def fails(indices):
        raise LookupError("no such entry")

    with pytest.raises(LookupError, match="no such entry"):
        graintrain.cross(fails, [4] * 4)
    with pytest.raises(ValueError, match="what the function returned has the shape"):
        graintrain.cross(lambda indices: np.zeros(3), [4] * 4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TrainVector.from_numpy(np.ones(6), modes=[2, 2]), "entries"),
        (lambda: TrainVector.from_numpy([1.0, np.nan]), "finite"),
        (lambda: TrainVector.from_numpy(np.ones(4), tolerance=-1.0), "tolerance"),
        (lambda: TrainMatrix.from_numpy(np.ones((3, 4))), "rows is 3, no power of two"),
        (lambda: TrainMatrix.from_numpy(np.ones(4)), "shape"),
        (lambda: TrainMatrix.from_sparse(np.ones((3, 4))), "3 x 4"),
        (lambda: TrainMatrix.identity([2, 2]) @ np.ones(3), r"expected \(4,\)"),
        (lambda: TrainVector.constant([2, 2], 1.0).dot(TrainVector.constant([4], 1.0)), "mode sizes"),
    ],
)
def test_messages_name_what_is_wrong(make, message):
    with pytest.raises(ValueError, match=message):
        make()
