"""What is known of a data set, and what is on disk once it was fetched."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from .._sgpr import Recording, Robot, SgprError
from ._tables import Table

ROBOTS = Path(__file__).parent / "robots"
"""Robot files that we wrote, from published kinematics alone: their masses stand for nothing."""


class DatasetError(SgprError):
    """A data set that cannot be had: no network, a file that is not the recorded one, a folder in use."""


@dataclass(frozen=True)
class Source:
    """A file at its origin, and how to know it again.

    - `sha256`: of the bytes that lie at `url`, which names one commit of a repository
    - `size`: bytes
    """

    url: str
    sha256: str
    size: int

    @property
    def file(self) -> str:
        """Its name without the path."""
        return self.url.rpartition("/")[2]


@dataclass(frozen=True)
class Log:
    """A log after the conversion, and whether it is there to train, to test, or neither ("other")."""

    file: str
    role: str
    what: str = ""


@dataclass(frozen=True)
class Dataset:
    """A public set of logs of one robot.

    - `torque`: what is taken as torque
    - `convert`: from the files of the origin, by name, to tables, by name of the log
    - `robot_file`: one of ours (`ROBOTS`) or of the origin's; none if the kinematics are not known
    - `effects`: friction and what else to begin with
    - `settings`: text of the `sgpr.toml` that is laid beside the logs
    - `physics`: what is known of the robot, for people
    - `published`: figures of others, and where they stand
    - `program`: Python in place of `sgpr identify`, where there is no robot; its last line prints what is `expected`
    - `unseen_percent`: |residual| / |torque| on the test logs after `sgpr identify` with these effects, measured
    """

    name: str
    robot: str
    torque: str
    rate_hz: float
    licence: str
    citation: str
    home: str
    sources: tuple[Source, ...]
    logs: tuple[Log, ...]
    convert: Callable[[Mapping[str, Path]], Mapping[str, Table]]
    robot_file: str | None
    effects: tuple[str, ...] = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")
    settings: str = ""
    physics: str = ""
    published: str = ""
    program: str = ""
    expected: str = ""
    unseen_percent: float | None = None

    @property
    def size(self) -> int:
        """Bytes to download."""
        return sum(source.size for source in self.sources)

    def files(self, role: str) -> list[str]:
        """Names of the logs of one role."""
        return [log.file for log in self.logs if log.role == role]


@dataclass(frozen=True)
class Fetched:
    """A data set on disk."""

    dataset: Dataset
    folder: Path

    @property
    def robot_file(self) -> Path | None:
        """The robot, for `Robot.from_urdf` and `--robot`."""
        return self.folder / self.dataset.robot_file if self.dataset.robot_file else None

    def paths(self, role: str) -> list[Path]:
        """The logs of a role: "train", "test" or "other"."""
        return [self.folder / name for name in self.dataset.files(role)]

    def load_robot(self) -> Robot:
        """The robot. Its inertias are what the origin states; in our own files they are placeholders.

        Raises `DatasetError` if the kinematics of this robot are not known.
        """
        # What reads a DH table is the command line's.
        from ..cli.project import joints_of
        from ..cli.robots import load_robot

        if self.robot_file is None:
            raise DatasetError(f"{self.dataset.name}: the origin says nothing of the kinematics of this robot")
        file = str(self.robot_file)
        return load_robot(file, joints_of(file, None, [str(self.folder / log.file) for log in self.dataset.logs]))

    def recordings(self, role: str) -> list[Recording]:
        """The logs of a role, read and repaired as the `sgpr.toml` beside them says."""
        from ..cli.reading import ReadingOptions, read_log

        joints = self.load_robot().joint_names if self.robot_file else None
        logs = [read_log(str(path), ReadingOptions(), joints) for path in self.paths(role)]
        return [stretch for log in logs for stretch in log.stretches]
