"""Granular and multibody dynamics with hard contact.

>>> import graintrain
>>> world = graintrain.World.from_scene("sedimentation", set={"n": 3})
>>> report = world.run(0.05)
>>> world.positions.shape
(343, 3)
"""

from graintrain import tt
from graintrain._graintrain import (
    Batch,
    CheckpointError,
    Contacts,
    Function,
    ModelError,
    Motion,
    NotDifferentiable,
    Picture,
    Problem,
    ProblemError,
    SceneError,
    Shape,
    SolveReport,
    StepError,
    StepGradient,
    StepReport,
    NotConverged,
    TrainError,
    TrainMatrix,
    TrainVector,
    World,
    __version__,
    cross,
    replay,
    solvers,
)
from graintrain._measure import stress
from graintrain._show import Replay, show
from graintrain._sweep import sweep

__all__ = [
    "Batch",
    "CheckpointError",
    "Contacts",
    "Function",
    "ModelError",
    "Motion",
    "NotDifferentiable",
    "Picture",
    "Problem",
    "ProblemError",
    "Replay",
    "SceneError",
    "Shape",
    "SolveReport",
    "StepError",
    "StepGradient",
    "StepReport",
    "NotConverged",
    "TrainError",
    "TrainMatrix",
    "TrainVector",
    "World",
    "__version__",
    "cross",
    "replay",
    "show",
    "solvers",
    "stress",
    "sweep",
    "tt",
]
