"""Tensor trains: everything of the crate graintrain-tt under its names, with arrays of NumPy in and out.

Its TtVector and TtMatrix are TrainVector and TrainMatrix here; trains of known ranks are in graintrain.tt.qtt.

>>> from graintrain import tt
>>> grid = tt.Grid({"x": (0, 1, 20), "y": (0, 1, 20)})
>>> f, report = grid.cross(lambda x, y: x * y**2, 1e-10)
>>> round(f.integral(), 9)
0.166666667
"""

from graintrain._graintrain import (
    ComplexMatrix,
    ComplexVector,
    FullOperator,
    Grid,
    GridFunction,
    OperatorSum,
    QuadtreeMatrix,
    Sketch,
    SymmetricTrain,
    TrainError,
    TrainMatrix,
    TrainVector,
    convolution,
    cross,
    cross_sparse,
    ends_of_modes,
    evolve,
    fit,
    fourier,
    gmres,
    inverse,
    inverse_residual,
    local_operator,
    lowest_eigenpairs,
    map,
    maxvol,
    measured_residual,
    newton_schulz,
    read_mat,
    read_sdv,
    solve_matrix,
    sub_grid,
    write_sdv,
)
from graintrain.tt import qtt

__all__ = [
    "ComplexMatrix",
    "ComplexVector",
    "FullOperator",
    "Grid",
    "GridFunction",
    "OperatorSum",
    "QuadtreeMatrix",
    "Sketch",
    "SymmetricTrain",
    "TrainError",
    "TrainMatrix",
    "TrainVector",
    "convolution",
    "cross",
    "cross_sparse",
    "ends_of_modes",
    "evolve",
    "fit",
    "fourier",
    "gmres",
    "inverse",
    "inverse_residual",
    "local_operator",
    "lowest_eigenpairs",
    "map",
    "maxvol",
    "measured_residual",
    "newton_schulz",
    "qtt",
    "read_mat",
    "read_sdv",
    "solve_matrix",
    "sub_grid",
    "write_sdv",
]
