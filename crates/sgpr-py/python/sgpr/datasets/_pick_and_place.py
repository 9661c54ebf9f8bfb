"""What the two sets of pick-and-place motions of A. Polydoros and L. Nalpantidis share."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ._dataset import Log
from ._tables import Array, Table, at_rate, joints, matlab

PLACE = (
    "https://raw.githubusercontent.com/woutervandijk0/Inverse_dynamics_learning/"
    "3e6d5f77a015ebdf0bafc4998b7d24f4413afabd/Data"
)
HOME = "https://github.com/woutervandijk0/Inverse_dynamics_learning"
CITATION = (
    "A. S. Polydoros, L. Nalpantidis: A reservoir computing approach for learning forward dynamics of industrial "
    "manipulators. IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS), 2016"
)
LICENCE = "MIT, as the repository says of itself"

TRAJECTORIES = range(1, 8)
LOGS = tuple(Log(f"traj0{number}.csv", "train" if number < 6 else "test") for number in TRAJECTORIES)
RATE_HZ = 100.0


def converted(file: str, prefix: str, order: Sequence[int]) -> Callable[[Mapping[str, Path]], dict[str, Table]]:
    """Of each trajectory position, velocity and torque; the targets of its prediction that follow are left out.

    - `order`: columns of the origin in the order from the base to the wrist
    """

    def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
        arrays = matlab(sources[file])
        return {log.file: table(arrays[f"{prefix}{number}"], order) for number, log in enumerate(LOGS, start=1)}

    return convert


def table(rows: Array, order: Sequence[int]) -> Table:
    """One trajectory."""
    q, dq, tau = (rows[:, 7 * block : 7 * block + 7][:, list(order)] for block in range(3))
    return at_rate(len(rows), RATE_HZ) | joints("q", "rad", q) | joints("dq", "rad_s", dq) | joints("tau", "Nm", tau)
