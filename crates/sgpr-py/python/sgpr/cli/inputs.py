"""What a file is, and models by what the user names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from .. import Model, SemiParametricModel
from .._sgpr import load
from ..loading import load as load_either
from ..reading import is_log
from .console import Output
from .errors import BadData
from .robots import LOGS, READY_MADE, load_robot

Kind = Literal["robot", "model", "log"]

HEAD_BYTES = 256

SLOW_BYTES = 5_000_000
"""More points than in a file of this size take longer than a person waits without a word: their cube counts."""


def kind_of(name: str) -> Kind:
    """Whether a name stands for a robot, a saved model or a log: by its content, then by its suffix."""
    path = Path(name)
    if name in READY_MADE and not path.exists():
        return "robot"
    # Folders; and pipes and devices, which the reader of logs refuses: to open one may wait for ever.
    if (path.exists() and not path.is_file()) or (not path.exists() and is_log(path)):
        return "log"
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    suffix = path.suffix.lower()
    if suffix == ".sgpr" or b'"sgpr torque model"' in head or head[8:10] == b'{"':
        return "model"
    if (text.startswith(b"<") and not path.name.lower().endswith(LOGS)) or suffix in (
        ".urdf",
        ".xml",
        ".toml",
        ".json",
    ):
        return "robot"
    return "log"


def load_model(name: str, joints: Sequence[str] | None = None, gravity: Sequence[float] | None = None) -> Model:
    """A saved model, or the model that a robot file describes."""
    if kind_of(name) == "model":
        model = load(name)
        if joints and list(joints) != model.robot.joint_names:
            raise BadData(
                f"{name}: this model is of the joints {', '.join(model.robot.joint_names)}: `joints` must name them all"
            )
        return model
    return Model.nominal(load_robot(name, joints, gravity))


def load_any_model(name: str, joints: Sequence[str] | None = None) -> Model | SemiParametricModel:
    """The same, or a saved model of physics and what it leaves over."""
    if kind_of(name) != "model":
        return load_model(name, joints)
    size = Path(name).stat().st_size
    if size > SLOW_BYTES:
        # On standard error, whatever the command prints: silence would look like a program that hangs.
        Output().note(f"{name}: {size / 1e6:.0f} MB of points are computed with again, which may take minutes")
    model = load_either(name)
    if joints and list(joints) != model.robot.joint_names:
        raise BadData(
            f"{name}: this model is of the joints {', '.join(model.robot.joint_names)}: `joints` must name them all"
        )
    return model
