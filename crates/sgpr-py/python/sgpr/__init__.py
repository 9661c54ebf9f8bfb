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
    DriveGains,
    GaussianProcessError,
    IdentificationError,
    IdentificationReport,
    Issue,
    JointComparison,
    Kernel,
    LogResidual,
    Model,
    ModelFileError,
    Parameter,
    Parameters,
    Payload,
    Predictor,
    Processing,
    ProcessPredictor,
    Recording,
    RecordingError,
    Repaired,
    Robot,
    RobotError,
    SemiParametricPredictor,
    SgprError,
    __version__,
    compare,
    cutoff_influence,
    effects,
    identify,
    identify_drive_gains,
    identify_payload,
    read_csv,
    read_mcap,
    regroupings,
    screen,
    write_mcap,
)
from .gaussian_process import GaussianProcess
from .loading import load
from .reading import read
from .semi_parametric import SemiParametricModel

__all__ = [
    "BaseParameters",
    "Comparison",
    "CutoffChoice",
    "CutoffInfluence",
    "DriveGains",
    "GaussianProcess",
    "GaussianProcessError",
    "IdentificationError",
    "IdentificationReport",
    "Issue",
    "JointComparison",
    "Kernel",
    "LogResidual",
    "Model",
    "ModelFileError",
    "Parameter",
    "Parameters",
    "Payload",
    "Predictor",
    "ProcessPredictor",
    "Processing",
    "Recording",
    "RecordingError",
    "Repaired",
    "Robot",
    "RobotError",
    "SemiParametricModel",
    "SemiParametricPredictor",
    "SgprError",
    "__version__",
    "compare",
    "cutoff_influence",
    "effects",
    "identify",
    "identify_drive_gains",
    "identify_payload",
    "load",
    "read",
    "read_csv",
    "read_mcap",
    "regroupings",
    "robots",
    "screen",
    "write_mcap",
]
