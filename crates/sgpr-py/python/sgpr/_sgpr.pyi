"""The compiled half of sgpr. Docstrings are those of the module; this file gives the types."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Path = str | PathLike[str]
Progress = Callable[[str, int, int], object]

__version__: str

class SgprError(ValueError): ...
class RobotError(SgprError): ...
class RecordingError(SgprError): ...
class IdentificationError(SgprError): ...
class ModelFileError(SgprError): ...

@final
class Robot:
    @staticmethod
    def from_urdf(
        path: Path,
        joints: Sequence[str] | None = None,
        *,
        locked: Mapping[str, float] | None = None,
        gravity: Sequence[float] | Array = (0.0, 0.0, -9.81),
    ) -> Robot: ...
    @staticmethod
    def from_urdf_text(
        text: str,
        joints: Sequence[str] | None = None,
        *,
        origin: str = "urdf",
        locked: Mapping[str, float] | None = None,
        gravity: Sequence[float] | Array = (0.0, 0.0, -9.81),
    ) -> Robot: ...
    @staticmethod
    def from_dh(
        rows: Sequence[Mapping[str, Any]],
        *,
        convention: Literal["standard", "modified"],
        name: str = "robot",
        joint_names: Sequence[str] | None = None,
        gravity: Sequence[float] | Array = (0.0, 0.0, -9.81),
    ) -> Robot: ...
    @property
    def name(self) -> str: ...
    @property
    def dof(self) -> int: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def joint_kinds(self) -> list[str]: ...
    @property
    def position_units(self) -> list[str]: ...
    @property
    def torque_units(self) -> list[str]: ...
    @property
    def limits(self) -> dict[str, Array]: ...  # "lower" "upper" "velocity" "effort", each (n,), inf where none
    @property
    def frames(self) -> list[str]: ...
    @property
    def gravity(self) -> Array: ...
    @property
    def standard_parameters(self) -> Array: ...
    @property
    def standard_parameter_names(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def with_gravity(self, gravity: Sequence[float] | Array) -> Robot: ...
    def with_standard_parameters(self, parameters: ArrayLike) -> Robot: ...
    # one sample (n,) or many (N, n)
    def inverse_dynamics(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array: ...
    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array: ...
    def mass_matrix(self, q: ArrayLike) -> Array: ...
    def bias_forces(self, q: ArrayLike, dq: ArrayLike) -> Array: ...
    def gravity_torque(self, q: ArrayLike) -> Array: ...
    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array: ...
    def forward_kinematics(self, q: ArrayLike, frame: str | None = None) -> Array: ...  # (..., 4, 4)
    def jacobian(self, q: ArrayLike, frame: str | None = None) -> Array: ...  # (..., 6, n)
    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike) -> Array: ...  # (N,) or float
    def potential_energy(self, q: ArrayLike) -> Array: ...
    def base_parameters(self, effects: Sequence[str] = ()) -> BaseParameters: ...

@final
class BaseParameters:
    @property
    def rank(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def expressions(self) -> list[str]: ...
    @property
    def matrix(self) -> Array: ...  # (rank, parameters): base = matrix @ parameters
    @property
    def parameter_names(self) -> list[str]: ...
    @property
    def classes(self) -> dict[str, str]: ...  # parameter -> "identifiable" | "combination" | "invisible"

@final
class Issue:
    kind: str  # "not_finite", "gap", ...
    severity: Literal["error", "warning", "note"]
    time: float | None
    channel: str | None
    count: int
    message: str

@final
class Recording:
    def __init__(
        self,
        t: ArrayLike,  # (N,) seconds, or integer nanoseconds
        q: ArrayLike,  # (N, n)
        dq: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        joint_names: Sequence[str] | None = None,  # joint_1, ...
        channels: Mapping[str, ArrayLike] | None = None,
        source: str = "array",
    ) -> None: ...
    @property
    def source(self) -> str: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def dof(self) -> int: ...
    @property
    def t(self) -> Array: ...  # seconds since the first sample
    @property
    def time_ns(self) -> NDArray[np.int64]: ...
    @property
    def q(self) -> Array: ...
    @property
    def dq(self) -> Array | None: ...
    @property
    def tau(self) -> Array | None: ...
    @property
    def channels(self) -> dict[str, Array]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def issues(self) -> list[Issue]: ...
    @property
    def sample_rate_hz(self) -> float | None: ...
    @property
    def duration(self) -> float: ...
    def __len__(self) -> int: ...
    def select(self, joints: Sequence[str]) -> Recording: ...
    def renamed(self, joints: Sequence[str]) -> Recording: ...
    def slice(self, start: int, stop: int) -> Recording: ...
    def repair(
        self,
        *,
        trim: tuple[float, float] | None = None,
        sort: bool = False,
        drop_duplicates: bool = False,
        drop_not_finite: bool = False,
        drop_repeated: bool = False,
        split_gaps: float | None = None,
        resample: float | Literal["median"] | None = None,
    ) -> Repaired: ...
    def average_periods(self, period: float) -> tuple[Recording, dict[str, Array]]: ...
    def save(self, path: Path) -> None: ...  # .csv, .csv.gz, .mcap

@final
class Repaired:
    recordings: list[Recording]
    actions: list[str]

def read_csv(
    path: Path,
    joints: Sequence[str] | None = None,
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,  # time, position, velocity, torque: pattern or names
    units: Mapping[str, str] | None = None,  # position: deg, velocity: rpm, torque: mNm, time: ms
    torque_constants: Sequence[float] | Array | None = None,
    rows: tuple[int, int] | None = None,
    seconds: tuple[float, float] | None = None,
    sample_rate_hz: float | None = None,
    limit_bytes: int | None = None,
) -> Recording: ...
def read_mcap(
    path: Path,
    joints: Sequence[str] | None = None,
    *,
    logged_names: Sequence[str] | None = None,
    topics: Sequence[str] | None = None,
    clock: Literal["header", "log"] = "header",
    recover: bool = False,
    limit_bytes: int | None = None,
) -> Recording: ...
def write_mcap(path: Path, topics: Mapping[str, Recording]) -> None: ...

@final
class Parameter:
    name: str
    expression: str  # the combination of standard parameters that it stands for
    unit: str
    value: float
    standard_deviation: float | None  # inf: the motion does not determine it
    relative_standard_deviation: float | None  # percent
    nominal: float

@final
class Parameters:
    """Base parameters of a model: a sequence of Parameter, with the columns as arrays."""

    @property
    def names(self) -> list[str]: ...
    @property
    def expressions(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def values(self) -> Array: ...
    @property
    def standard_deviations(self) -> Array: ...  # nan for a model that was not identified
    @property
    def nominal(self) -> Array: ...
    @property
    def covariance(self) -> Array | None: ...
    def __len__(self) -> int: ...
    def __getitem__(self, key: int | str) -> Parameter: ...
    def to_dict(self) -> list[dict[str, Any]]: ...

@final
class Processing:
    cutoff_hz: float
    order: int
    differentiation: str
    torque_cutoff_hz: float | None
    decimation: int
    standstill_speed: Array

@final
class Model:
    @staticmethod
    def nominal(robot: Robot) -> Model: ...
    @staticmethod
    def from_parameters(robot: Robot, parameters: ArrayLike, effects: Sequence[str] = ()) -> Model: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def identified_robot(self) -> Robot: ...
    @property
    def effects(self) -> list[str]: ...
    @property
    def parameters(self) -> Parameters: ...
    @property
    def all_parameters(self) -> Array: ...
    @property
    def all_parameter_names(self) -> list[str]: ...
    @property
    def processing(self) -> Processing | None: ...
    @property
    def fit(self) -> dict[str, Any] | None: ...  # method noise rows correlation condition scaled_condition undetermined
    @property
    def report(self) -> IdentificationReport | None: ...  # only on the model that identify returned
    @property
    def logs(self) -> list[str]: ...
    @property
    def history(self) -> list[str]: ...
    @property
    def library_version(self) -> str: ...
    def plus(self, error: Model) -> Model: ...
    def __add__(self, error: Model) -> Model: ...
    def predict(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array: ...
    def predictor(self) -> Predictor: ...
    def save(self, path: Path) -> None: ...

@final
class Predictor:
    """One sample after the other, for a control loop: writes into `out`, allocates nothing."""

    def torque(self, q: Array, dq: Array, ddq: Array, out: Array | None = None) -> Array: ...

@final
class CutoffChoice:
    cutoff_hz: float
    joint_hz: Array
    noise: Array
    frequency_hz: Array  # (F,)
    density: Array  # (n, F) of the position

@final
class IdentificationReport:
    samples: int
    singular_values: Array
    warnings: list[str]
    cutoff_choices: list[CutoffChoice]  # one per log

@final
class CutoffInfluence:
    cutoff_hz: float
    largest_change: float
    typical_change: float
    model: Model

def effects() -> list[dict[str, Any]]: ...  # name, summary, parameters [(name, unit, unit_prismatic)]
def identify(
    robot: Robot,
    recordings: Sequence[Recording],
    *,
    effects: Sequence[str] = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"),
    method: Literal["ols", "wls"] = "wls",
    noise: ArrayLike | None = None,  # known standard deviation per joint: method "wls" with it
    start: Literal["robot_file", "zero"] = "robot_file",
    cutoff_hz: float | None = None,
    filter_order: int = 4,
    differentiation: str = "central",  # "central:4", "savitzky_golay:11:3"
    torque_band: float | Literal["position", "full"] = "position",
    decimation: int | None = None,
    standstill_speed: float | None = None,
    progress: Progress | None = None,
) -> Model: ...
def cutoff_influence(
    robot: Robot, recordings: Sequence[Recording], model: Model, *, progress: Progress | None = None, **options: Any
) -> list[CutoffInfluence]: ...

@final
class JointComparison:
    joint: str
    unit: str
    samples: int
    rmse: float
    fit_percent: float
    r2: float
    relative_error_percent: float
    largest_error: float
    largest_error_log: str
    largest_error_time: float
    rmse_zero: float
    rmse_gravity: float
    rmse_full_band: float
    rmse_with_rests: float
    relative_error_with_rests_percent: float

@final
class LogResidual:
    source: str
    time_ns: NDArray[np.int64]
    t: Array
    measured: Array  # (N, n), as all below
    predicted: Array
    measured_in_band: Array
    predicted_in_band: Array
    counted: NDArray[np.bool_]
    q: Array
    dq: Array
    ddq: Array

@final
class Comparison:
    @property
    def joints(self) -> list[JointComparison]: ...
    @property
    def relative_error_percent(self) -> float: ...
    @property
    def relative_error_with_rests_percent(self) -> float: ...
    @property
    def logs(self) -> list[LogResidual]: ...
    # columns over the joints, (n,)
    @property
    def rmse(self) -> Array: ...
    @property
    def fit_percent(self) -> Array: ...
    @property
    def r2(self) -> Array: ...
    def to_dict(self) -> dict[str, Any]: ...  # figures only, ready for json

def compare(
    model: Model | Robot,
    recordings: Sequence[Recording],
    *,
    processing: Model | Processing | None = None,  # default: as the model was identified, else chosen from the logs
) -> Comparison: ...
def load(path: Path) -> Model: ...
def puma560() -> Robot: ...
def two_link() -> Robot: ...
