"""Torque models of robot arms: from a robot file and recorded logs to an identified model.

>>> robot = sgpr.Robot.from_urdf("robot.urdf")
>>> log = sgpr.read("train.csv.gz", joints=robot.joint_names)
>>> model = sgpr.identify(robot, [log])
>>> comparison = sgpr.compare(model, [log])

Samples are rows, joints are columns; SI units; time in integer nanoseconds. What the library cannot accept is an
`SgprError`, which is a `ValueError`.
"""

from . import robots
from ._sgpr import (
    BaseParameters,
    Comparison,
    CutoffChoice,
    CutoffInfluence,
    Diagnosis,
    Effect,
    Finding,
    IdentificationError,
    IdentificationReport,
    Issue,
    JointComparison,
    LogResidual,
    Model,
    ModelFileError,
    Parameter,
    Parameters,
    Predictor,
    Processing,
    Recording,
    RecordingError,
    Repaired,
    Robot,
    RobotError,
    SgprError,
    __version__,
    compare,
    cutoff_influence,
    diagnose,
    effects,
    identify,
    load,
    read_csv,
    read_mcap,
    write_mcap,
)
from .reading import read

__all__ = [
    "BaseParameters",
    "Comparison",
    "CutoffChoice",
    "CutoffInfluence",
    "Diagnosis",
    "Effect",
    "Finding",
    "IdentificationError",
    "IdentificationReport",
    "Issue",
    "JointComparison",
    "LogResidual",
    "Model",
    "ModelFileError",
    "Parameter",
    "Parameters",
    "Predictor",
    "Processing",
    "Recording",
    "RecordingError",
    "Repaired",
    "Robot",
    "RobotError",
    "SgprError",
    "__version__",
    "compare",
    "cutoff_influence",
    "diagnose",
    "effects",
    "identify",
    "load",
    "read",
    "read_csv",
    "read_mcap",
    "robots",
    "write_mcap",
]
