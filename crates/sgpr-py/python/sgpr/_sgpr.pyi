"""The compiled half of sgpr. Docstrings are those of the module; this file gives the types."""

import builtins
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, ClassVar, Final, Literal, TypedDict, Unpack, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .semi_parametric import SemiParametricModel

_Array = NDArray[np.float64]
_Purpose = Literal["expected_measurement", "feed_forward"]
_Path = str | PathLike[str]
_Progress = Callable[[str, int, int], object]

__all__ = [
    "BaseParameters",
    "Comparison",
    "Compensation",
    "CutoffChoice",
    "CutoffInfluence",
    "Diagnosis",
    "Drive",
    "DriveGains",
    "Effect",
    "Excitation",
    "ExcitationError",
    "Finding",
    "FittedProcess",
    "FittedSemiParametric",
    "GaussianProcessError",
    "IdentificationError",
    "IdentificationReport",
    "Issue",
    "JointComparison",
    "Kernel",
    "LogResidual",
    "LogSet",
    "Model",
    "ModelFileError",
    "MomentumObserver",
    "OnlineGaussianProcess",
    "OnlineModel",
    "Parameter",
    "Parameters",
    "Payload",
    "Pieces",
    "Predictor",
    "ProcessPredictor",
    "Processing",
    "Record",
    "Recording",
    "RecordingError",
    "Repaired",
    "Robot",
    "RobotError",
    "SemiParametricPredictor",
    "SessionComparison",
    "SgprError",
    "Simulation",
    "SimulationError",
    "Trajectory",
    "__version__",
    "choose_processing",
    "compare",
    "compare_records",
    "compare_sessions",
    "compare_streaming",
    "cutoff_influence",
    "deviations",
    "diagnose",
    "diagnose_records",
    "effects",
    "estimators",
    "excite",
    "fit_process",
    "fit_semi_parametric",
    "format_of",
    "formats",
    "identify",
    "identify_drive_gains",
    "identify_payload",
    "identify_records",
    "load",
    "puma560",
    "puma560_drives",
    "quantity_of_array",
    "read_columns",
    "read_csv",
    "read_log",
    "read_mcap",
    "read_parquet_pieces",
    "record",
    "register_effect",
    "regroupings",
    "repeated_share",
    "residual_structure",
    "restore_process",
    "screen",
    "shared_samples",
    "simulate",
    "two_link",
    "two_link_drives",
    "unregister_effect",
    "write_mcap",
]

__version__: Final[str]

class SgprError(ValueError): ...
class RobotError(SgprError): ...
class RecordingError(SgprError): ...
class IdentificationError(SgprError): ...
class GaussianProcessError(SgprError): ...
class ModelFileError(SgprError): ...
class ExcitationError(SgprError): ...
class SimulationError(SgprError): ...

@final
class Robot:
    @property
    def fingerprint(self) -> str: ...
    @staticmethod
    def from_urdf(
        path: _Path,
        joints: Sequence[str] | None = None,
        *,
        locked: Mapping[str, float] | None = None,
        gravity: Sequence[float] | _Array = (0.0, 0.0, -9.81),
    ) -> Robot: ...
    @staticmethod
    def from_urdf_text(
        text: str,
        joints: Sequence[str] | None = None,
        *,
        origin: str = "urdf",
        locked: Mapping[str, float] | None = None,
        gravity: Sequence[float] | _Array = (0.0, 0.0, -9.81),
    ) -> Robot: ...
    @staticmethod
    def from_dh(
        rows: Sequence[Mapping[str, Any]],
        *,
        convention: Literal["standard", "modified"],
        name: str = "robot",
        joint_names: Sequence[str] | None = None,
        gravity: Sequence[float] | _Array = (0.0, 0.0, -9.81),
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
    def limits(self) -> dict[str, _Array]: ...  # "lower" "upper" "velocity" "effort", each (n,), inf where none
    @property
    def frames(self) -> list[str]: ...
    @property
    def gravity(self) -> _Array: ...
    @property
    def standard_parameters(self) -> _Array: ...
    @property
    def standard_parameter_names(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def plot(self, q: ArrayLike | None = None) -> Any: ...  # plotly.graph_objects.Figure
    def _repr_html_(self) -> str: ...
    def with_gravity(self, gravity: Sequence[float] | _Array) -> Robot: ...
    def with_standard_parameters(self, parameters: ArrayLike) -> Robot: ...
    # one sample (n,) or many (N, n)
    def inverse_dynamics(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _Array: ...
    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> _Array: ...
    def mass_matrix(self, q: ArrayLike) -> _Array: ...
    def bias_forces(self, q: ArrayLike, dq: ArrayLike) -> _Array: ...
    def gravity_torque(self, q: ArrayLike) -> _Array: ...
    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _Array: ...
    def forward_kinematics(self, q: ArrayLike, frame: str | None = None) -> _Array: ...  # (..., 4, 4)
    def jacobian(self, q: ArrayLike, frame: str | None = None) -> _Array: ...  # (..., 6, n)
    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike) -> _Array: ...  # (N,) or float
    def potential_energy(self, q: ArrayLike) -> _Array: ...
    def base_parameters(self, effects: Sequence[str] = (), *, recursion: bool = False) -> BaseParameters: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

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
    def formulas(self) -> list[str]: ...  # "ZZ1R = ZZ1 + YY2", links numbered from one
    @property
    def matrix(self) -> _Array: ...  # (rank, parameters): base = matrix @ parameters
    @property
    def parameter_names(self) -> list[str]: ...
    @property
    def classes(self) -> dict[str, str]: ...  # parameter -> "identifiable" | "combination" | "invisible"
    def __len__(self) -> int: ...

@final
class Issue:
    @property
    def kind(self) -> str: ...  # "not_finite", "gap", ...
    @property
    def severity(self) -> Literal["error", "warning", "note"]: ...
    @property
    def rank(self) -> Literal["stop", "look", "know"]: ...
    @property
    def time(self) -> float | None: ...
    @property
    def channel(self) -> str | None: ...
    @property
    def count(self) -> int: ...
    @property
    def message(self) -> str: ...

@final
class Recording:
    def __new__(
        cls,
        t: ArrayLike,  # (N,) seconds, or integer nanoseconds
        q: ArrayLike,  # (N, n)
        dq: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        joint_names: Sequence[str] | None = None,  # joint_1, ...
        channels: Mapping[str, ArrayLike] | None = None,
        source: str = "array",
    ) -> Recording: ...
    @property
    def source(self) -> str: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def dof(self) -> int: ...
    @property
    def t(self) -> _Array: ...  # seconds since the first sample
    @property
    def time_ns(self) -> NDArray[np.int64]: ...
    @property
    def q(self) -> _Array: ...
    @property
    def dq(self) -> _Array | None: ...
    @property
    def tau(self) -> _Array | None: ...
    @property
    def channels(self) -> dict[str, _Array]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def layout(self) -> dict[str, Any] | None: ...  # time, joints, by_order, text
    @property
    def accepted(self) -> list[str]: ...
    @property
    def content_hash(self) -> str: ...
    def accept(self, kinds: Sequence[str]) -> Recording: ...
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
    def between(self, start: float, end: float) -> Recording: ...  # s
    def __getitem__(self, key: builtins.slice[int | None, int | None, int | None], /) -> Recording: ...
    def to_dataframe(self) -> Any: ...  # pandas.DataFrame
    @staticmethod
    def from_dataframe(frame: Any, joints: Sequence[str] | None = None, **options: Any) -> Recording: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def _repr_html_(self) -> str: ...
    def repair(
        self,
        *,
        trim: tuple[float, float] | None = None,
        sort: bool = False,
        drop_duplicates: bool = False,
        drop_not_finite: bool = False,
        replace_strays: bool = False,
        drop_repeated: bool = False,
        unwrap: bool = False,
        split_gaps: float | None = None,
        resample: float | Literal["median"] | None = None,
    ) -> Repaired: ...
    def average_periods(self, period: float, *, skip: int = 0) -> tuple[Recording, dict[str, _Array]]: ...
    def save(self, path: _Path) -> None: ...  # .csv, .csv.gz, .mcap
    def _from_source(self, source: str, notes: Sequence[str], layout: dict[str, Any] | None = None) -> Recording: ...

@final
class LogSet:
    def __new__(cls, recordings: _Logs, *, whole: bool = False) -> LogSet: ...
    @property
    def logs(self) -> list[Recording]: ...
    @property
    def origins(self) -> list[int]: ...
    @property
    def notes(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Recording: ...
    def __iter__(self) -> Iterator[Recording]: ...
    @staticmethod
    def _of(logs: Sequence[Recording]) -> LogSet: ...

_Logs = Sequence[Recording] | LogSet

@final
class Repaired:
    @property
    def recordings(self) -> list[Recording]: ...
    @property
    def actions(self) -> list[str]: ...

@final
class Pieces:
    def __iter__(self) -> Pieces: ...
    def __next__(self) -> Recording: ...

def quantity_of_array(name: str) -> str | None: ...
def format_of(path: _Path) -> tuple[str, list[str]]: ...
def formats() -> list[tuple[str, list[str], list[str]]]: ...
def read_columns(
    source: str,
    names: Sequence[str],
    values: Sequence[_Array | NDArray[Any] | list[str]],
    joints: Sequence[str] | None = None,
    **options: Any,
) -> Recording: ...
def read_csv(
    path: _Path,
    joints: Sequence[str] | None = None,
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,  # time, position, velocity, torque: pattern or names
    units: Mapping[str, str] | None = None,  # position: deg, velocity: rpm, torque: mNm, time: ms
    torque_constants: Sequence[float] | _Array | Mapping[str, float] | None = None,
    accept: Sequence[str] | None = None,  # findings that are right, as in Recording.accept
    rows: tuple[int, int] | None = None,
    seconds: tuple[float, float] | None = None,
    sample_rate_hz: float | None = None,
    limit_bytes: int | None = None,
) -> Recording: ...
def read_mcap(
    path: _Path,
    joints: Sequence[str] | None = None,
    *,
    logged_names: Sequence[str] | None = None,
    topics: Sequence[str] | None = None,
    clock: Literal["header", "log"] = "header",
    recover: bool = False,
    limit_bytes: int | None = None,
) -> Recording: ...
def read_log(path: _Path, joints: Sequence[str] | None = None, **options: Any) -> Recording: ...
def read_parquet_pieces(path: _Path, samples: int, joints: Sequence[str] | None = None, **options: Any) -> Pieces: ...
def write_mcap(path: _Path, topics: Mapping[str, Recording]) -> None: ...

@final
class Parameter:
    __dataclass_fields__: ClassVar[dict[str, Any]]
    @property
    def name(self) -> str: ...
    @property
    def expression(self) -> str: ...  # the combination of standard parameters that it stands for
    @property
    def unit(self) -> str: ...
    @property
    def value(self) -> float: ...
    @property
    def standard_deviation(self) -> float | None: ...  # inf: the motion does not determine it
    @property
    def relative_standard_deviation(self) -> float | None: ...  # percent
    @property
    def nominal(self) -> float: ...

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
    def values(self) -> _Array: ...
    @property
    def standard_deviations(self) -> _Array: ...  # nan for a model that was not identified
    @property
    def nominal(self) -> _Array: ...
    @property
    def covariance(self) -> _Array | None: ...
    def __len__(self) -> int: ...
    def __getitem__(self, key: int | str, /) -> Parameter: ...
    def __iter__(self) -> Iterator[Parameter]: ...
    def to_dict(self) -> list[dict[str, Any]]: ...
    def _repr_html_(self) -> str: ...

@final
class Processing:
    @property
    def cutoff_hz(self) -> float: ...
    @property
    def order(self) -> int: ...
    @property
    def differentiation(self) -> str: ...
    @property
    def torque_cutoff_hz(self) -> float | None: ...
    @property
    def decimation(self) -> int: ...
    @property
    def standstill_speed(self) -> _Array: ...
    @property
    def turn_margin(self) -> float: ...
    def reach(self, rate_hz: float) -> int: ...  # samples
    def in_band(self, torque: ArrayLike, rate_hz: float) -> _Array: ...
    @staticmethod
    def from_json(text: str) -> Processing: ...
    def to_json(self) -> str: ...
    def __reduce__(self) -> Any: ...
    def __eq__(self, other: object, /) -> bool: ...

@final
class Record:
    @property
    def robot(self) -> str: ...  # fingerprint
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def effects(self) -> list[str]: ...
    @property
    def processing(self) -> Processing: ...
    @property
    def source(self) -> str: ...
    @property
    def content_hash(self) -> str: ...
    @property
    def counted(self) -> tuple[int, int] | None: ...  # ns
    @property
    def start_time(self) -> int: ...  # ns
    @property
    def end_time(self) -> int: ...  # ns
    @property
    def samples(self) -> int: ...
    @property
    def rows(self) -> int: ...
    @property
    def findings(self) -> list[str]: ...
    @property
    def screening(self) -> list[dict[str, Any]]: ...
    @property
    def labels(self) -> dict[str, str]: ...
    @property
    def library_version(self) -> str: ...
    @property
    def blocks(self) -> list[dict[str, Any]]: ...  # start_time, end_time, channels, rows
    @property
    def suspects(self) -> list[dict[str, Any]]: ...  # effect, joint, constants
    def factors(self, block: int) -> list[dict[str, Any]]: ...  # joint, resting, columns, rows, factor
    def to_parts(self) -> tuple[str, _Array]: ...
    @staticmethod
    def from_parts(head: str, numbers: ArrayLike) -> Record: ...
    def __reduce__(self) -> Any: ...

class _Equations(TypedDict, total=False):
    effects: Sequence[str]
    cutoff_hz: float | None
    filter_order: int
    differentiation: str
    torque_band: float | Literal["position", "full"]
    decimation: int | None
    standstill_speed: float | None
    turn_margin: float

class _EquationOptions(_Equations, total=False):
    progress: _Progress | None

class _OfSums(TypedDict, total=False):
    method: str
    noise: ArrayLike | None
    start: Literal["robot_file", "zero"]
    prior: Literal["entropic", "euclidean"] | None
    prior_deviation: float | Literal["auto"] | None
    bounds: Mapping[str, Any] | None
    essential: bool

class _RecordsOptions(_OfSums, total=False):
    consistent: bool

class _Estimation(_Equations, _OfSums, total=False):
    forecast: bool
    uncertainty: str
    instruments: _Logs
    kp: ArrayLike | None
    kd: ArrayLike | None

class _InfluenceOptions(_Estimation, total=False):
    consistent: bool

class _PayloadOptions(_Estimation, total=False):
    progress: _Progress | None

class _GainOptions(_PayloadOptions, total=False):
    consistent: bool

class _MotionOptions(TypedDict, total=False):
    basis: Literal["fourier", "b_spline", "point_to_point"]
    fundamental_hz: float
    terms: int
    harmonics: tuple[int, int] | None
    duration: float
    points: int
    max_acceleration: ArrayLike
    position_range: Sequence[Sequence[float]] | None
    max_velocity: ArrayLike | None
    max_torque: ArrayLike | None

class _ExcitationOptions(_MotionOptions, total=False):
    floor: float | None
    boxes: Sequence[Any] | None
    self_collision: bool
    clearance: float
    link_radius: Any
    link_shapes: Any
    max_tip_speed: float | None

def choose_processing(robot: Robot, recordings: _Logs, **options: Unpack[_EquationOptions]) -> Processing: ...
def record(
    robot: Robot,
    recording: Recording,
    *,
    processing: Model | Processing | None = None,  # default: chosen from this log
    effects: Sequence[str] | None = None,  # default: those of the model, else those of identify
    blocks: int = 5,
    counted: tuple[int, int] | None = None,  # ns
    lags: bool = True,
    suspects: Sequence[str] = (),
    labels: Mapping[str, str] | None = None,
) -> Record: ...
def identify_records(robot: Robot, records: Sequence[Record], **options: Unpack[_RecordsOptions]) -> Model: ...

# tests (effect joint constants found gain gain_standard_error parameters alternatives),
# left_out_errors (joint without with)
def diagnose_records(robot: Robot, records: Sequence[Record]) -> dict[str, Any]: ...
def compare_records(model: Model, records: Sequence[Record]) -> list[dict[str, Any]]: ...  # joint, rows, rmse, torque
def deviations(model: Model, record: Record, *, by_block: bool = False) -> list[dict[str, Any]]: ...

@final
class SessionComparison:
    @property
    def names(self) -> list[str]: ...
    @property
    def sentences(self) -> list[str]: ...
    # Keys: cause joint unit values standard_deviations chance saved_percent saved_percent_standard_error changed
    @property
    def tests(self) -> list[dict[str, Any]]: ...
    def model(self, name: str) -> Model: ...

def compare_sessions(
    robot: Robot, sessions: Mapping[str, _Logs], **options: Unpack[_EquationOptions]
) -> SessionComparison: ...

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
    def terms(self) -> list[dict[str, Any]]: ...  # effect, joints, parameters
    @property
    def parameters(self) -> Parameters: ...
    @property
    def all_parameters(self) -> _Array: ...
    @property
    def all_parameter_names(self) -> list[str]: ...
    @property
    def processing(self) -> Processing | None: ...
    # Keys: method noise rows correlation dispersion half_interval_95 prior_standard_deviation condition
    # scaled_condition undetermined
    @property
    def fit(self) -> dict[str, Any] | None: ...
    @property
    def report(self) -> IdentificationReport | None: ...  # only on the model that identify returned
    @property
    def logs(self) -> list[str]: ...
    @property
    def history(self) -> list[str]: ...
    @property
    def library_version(self) -> str: ...
    def plus(self, error: Model) -> Model: ...
    def add(self, finding: Finding | str, train: _Logs | None = None) -> Model: ...
    def __add__(self, error: Model, /) -> Model: ...
    def __radd__(self, model: Model, /) -> Model: ...
    @overload
    def predict(self, q: LogSet, *, return_std: Literal[False] = False) -> list[_Array]: ...
    @overload
    def predict(self, q: LogSet, *, return_std: Literal[True]) -> list[tuple[_Array, _Array]]: ...
    @overload
    def predict(
        self,
        q: ArrayLike | Recording,
        dq: ArrayLike | None = None,
        ddq: ArrayLike | None = None,
        *,
        return_std: Literal[False] = False,
    ) -> _Array: ...
    @overload
    def predict(
        self,
        q: ArrayLike | Recording,
        dq: ArrayLike | None = None,
        ddq: ArrayLike | None = None,
        *,
        return_std: Literal[True],
    ) -> tuple[_Array, _Array]: ...
    def standard_deviation(self, log: LogResidual) -> _Array: ...  # along a log of sgpr.compare
    @property
    def certificate(self) -> dict[str, Any] | None: ...  # links, active, cost
    def write_urdf(self, source: _Path, path: _Path, *, locked: Mapping[str, float] | None = None) -> None: ...
    def to_mjcf(self) -> str: ...
    def predictor(
        self,
        *,
        rate_hz: float | None = None,
        purpose: _Purpose = "expected_measurement",
        keep: Sequence[str] | None = None,
    ) -> Predictor: ...
    def export(
        self,
        language: Literal["c", "rust"],
        path: _Path,
        *,
        precision: Literal["double", "single"] = "double",
        name: str | None = None,
        rate_hz: float | None = None,
        purpose: _Purpose = "feed_forward",
        keep: Sequence[str] | None = None,
    ) -> None: ...
    def save(self, path: _Path) -> None: ...
    def plot(self, recordings: _Logs) -> Any: ...  # plotly.graph_objects.Figure
    def save_report(self, path: _Path, recordings: _Logs) -> None: ...
    def _repr_html_(self) -> str: ...
    @property
    def reading(self) -> dict[str, Any] | None: ...
    def with_reading(self, reading: Mapping[str, Any] | None) -> Model: ...
    def to_bytes(self) -> bytes: ...
    @staticmethod
    def from_bytes(data: bytes, *, origin: str = "bytes") -> Model: ...

@final
class Predictor:
    """One sample after the other, for a control loop; hidden states are carried from call to call."""

    @property
    def purpose(self) -> _Purpose: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def time(self) -> float: ...  # s
    def reset(self, q: ArrayLike | None = None, dq: ArrayLike | None = None, *, time: float = 0.0) -> None: ...
    def set_temperature(self, celsius: ArrayLike) -> None: ...
    def torque(
        self, q: _Array, dq: _Array, ddq: _Array, out: _Array | None = None, *, step: float | None = None
    ) -> _Array: ...

@final
class MomentumObserver:
    """Torque from outside, from positions, velocities and the torque of the drives."""

    def __new__(
        cls,
        model: Model,
        *,
        rate_hz: float,
        bandwidth_hz: float = 2.0,
        false_alarms_per_hour: float = 1.0,
        deviation: ArrayLike | None = None,
        without_contact: _Logs | None = None,
    ) -> MomentumObserver: ...
    @property
    def errors(self) -> _Array: ...  # (n, 3): moving, resting, N·m; speed, rad/s
    @property
    def thresholds(self) -> _Array: ...  # (n,), N·m
    @property
    def external_torque(self) -> _Array: ...  # (n,), N·m
    @property
    def alarm(self) -> tuple[int, float, float] | None: ...  # joint, its torque and threshold
    def reset(self) -> None: ...
    def update(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> _Array: ...

@final
class Compensation:
    """Torque that holds an arm and overcomes its friction in the direction of the wanted velocity."""

    def __new__(
        cls,
        model: Model,
        *,
        friction: float = 0.8,
        transition_speed: float = 0.02,
        limits: ArrayLike | None = None,
        rate_hz: float | None = None,
        keep: Sequence[str] | None = None,
    ) -> Compensation: ...
    def torque(self, q: ArrayLike, wanted_dq: ArrayLike) -> _Array: ...

@final
class CutoffChoice:
    @property
    def cutoff_hz(self) -> float: ...
    @property
    def joint_hz(self) -> _Array: ...
    @property
    def noise(self) -> _Array: ...
    @property
    def frequency_hz(self) -> _Array: ...  # (F,)
    @property
    def density(self) -> _Array: ...  # (n, F) of the position

@final
class IdentificationReport:
    @property
    def samples(self) -> int: ...
    @property
    def singular_values(self) -> _Array: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def cutoff_choices(self) -> list[CutoffChoice]: ...  # one per log
    @property
    def essential(self) -> dict[str, Any] | None: ...  # kept, dropped, rise, limit, validation
    @property
    def forecast(self) -> dict[str, Any] | None: ...  # seconds, deviation, noise, enough_at, seconds_to_go, advice

@final
class CutoffInfluence:
    @property
    def cutoff_hz(self) -> float: ...
    @property
    def largest_change(self) -> float: ...
    @property
    def typical_change(self) -> float: ...
    @property
    def model(self) -> Model: ...

def estimators() -> list[dict[str, Any]]: ...  # name, title, setting, usual, needs
def effects() -> list[dict[str, Any]]: ...  # name, summary, parameters [(name, unit, unit_prismatic)], formula, ...
def identify(
    robot: Robot,
    recordings: _Logs,
    *,
    effects: Sequence[str] = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"),
    method: str = "wls",  # "ols", "irls:1.345", ...: estimators()
    noise: ArrayLike | None = None,  # known standard deviation per joint: method "wls" with it
    start: Literal["robot_file", "zero"] = "robot_file",
    cutoff_hz: float | None = None,
    filter_order: int = 4,
    differentiation: str = "central",  # "central:4", "savitzky_golay:11:3"
    torque_band: float | Literal["position", "full"] = "position",
    decimation: int | None = None,
    standstill_speed: float | None = None,
    turn_margin: float = 0.0,
    consistent: bool = False,
    prior: Literal["entropic", "euclidean"] | None = "entropic",
    prior_deviation: float | Literal["auto"] | None = None,
    bounds: Mapping[str, Any] | None = None,
    essential: bool = False,
    forecast: bool = False,
    uncertainty: str = "memory",  # "hac", "bootstrap:500"
    instruments: _Logs = (),
    kp: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    progress: _Progress | None = None,
) -> Model: ...
def cutoff_influence(
    robot: Robot,
    recordings: _Logs,
    model: Model,
    *,
    progress: _Progress | None = None,
    **options: Unpack[_InfluenceOptions],
) -> list[CutoffInfluence]: ...
def diagnose(
    model: Model,
    train: _Logs,
    test: _Logs = (),
    *,
    effects: Sequence[str | Effect] | None = None,
    add: Sequence[str] | None = None,  # by hand, without a search: torque_ripple@joint_2
    progress: _Progress | None = None,
    ranked: Callable[[list[dict[str, Any]]], object] | None = None,
) -> Diagnosis: ...

class _Dependence(TypedDict):
    on: str
    correlation: float
    band: float  # what noise alone reaches

class _Shares(TypedDict):
    state: float
    time: float
    noise: float

class _Change(TypedDict):
    time: float  # s
    interval: list[float]
    end: float | None
    probability: float
    share: float

class _Input(TypedDict):
    variable: str
    alone: float
    total: float

class _Structure(TypedDict):
    joint: str
    rmse: float
    rows: int
    independent_rows: float
    whiteness: float  # probability that noise is as far from white
    dependence: list[_Dependence]
    shares: _Shares  # of the variance
    inputs: list[_Input]
    change: _Change | None
    shape: list[str]
    summary: str

class _Constant(TypedDict):
    name: str
    value: float
    standard_deviation: float | None
    unit: str

class _Detectable(TypedDict):
    effect: str
    joints: list[str]
    constants: list[_Constant]
    parameter: str
    unit: str
    seen_from: float | None
    torque: float | None
    visible: float
    told_apart_from: float | None
    mistaken_for: str | None

@final
class Diagnosis:
    @property
    def verdict(self) -> Literal["effects_found", "nothing_missing", "unexplained_structure"]: ...
    @property
    def probability_nothing_missing(self) -> float: ...
    @property
    def probability_unexplained(self) -> float: ...
    @property
    def findings(self) -> list[Finding]: ...
    @property
    def candidates(self) -> list[Finding]: ...
    @property
    def not_testable(self) -> dict[str, str]: ...
    @property
    def detectable(self) -> list[_Detectable]: ...
    @property
    def unexplained(self) -> list[str]: ...
    @property
    def structure(self) -> list[_Structure]: ...
    @property
    def left(self) -> list[_Structure]: ...
    @property
    def formulas(self) -> dict[str, str]: ...
    @property
    def next_motion(self) -> Recording | None: ...
    def save_next_motion(self, path: _Path) -> None: ...
    @property
    def model(self) -> Model: ...
    def to_dict(self) -> dict[str, Any]: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def report(self, path: _Path) -> None: ...
    def _repr_html_(self) -> str: ...

def residual_structure(model: Model, comparison: Comparison) -> list[_Structure]: ...

@final
class Finding:
    @property
    def effect(self) -> str: ...
    @property
    def joints(self) -> list[str]: ...
    @property
    def probability(self) -> float: ...
    @property
    def score(self) -> float: ...
    @property
    def parameters(self) -> dict[str, tuple[float, float | None, str]]: ...
    @property
    def rmse_before(self) -> dict[str, float]: ...
    @property
    def rmse_after(self) -> dict[str, float]: ...
    @property
    def error_gained_percent(self) -> float: ...
    @property
    def evidence(self) -> str: ...
    @property
    def confusable_with(self) -> list[str]: ...
    @property
    def separating_experiment(self) -> str: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def _repr_html_(self) -> str: ...

@final
class Effect:
    def __new__(
        cls,
        name: str,
        function: Callable[..., ArrayLike],  # (joint, q, dq, ddq, **constants, channels={})
        parameters: Sequence[str],
        *,
        constants: Mapping[str, tuple[float, float] | tuple[float, float, str]] | None = None,
        channels: Sequence[str] | None = None,
        summary: str | None = None,
        unit: str = "",
    ) -> Effect: ...
    @property
    def name(self) -> str: ...

def register_effect(effect: Effect) -> None: ...
def unregister_effect(effect: Effect) -> None: ...

@final
class Payload:
    @property
    def link(self) -> str: ...
    @property
    def mass(self) -> float: ...
    @property
    def mass_deviation(self) -> float: ...
    @property
    def centre(self) -> _Array: ...
    @property
    def parameters(self) -> _Array: ...
    @property
    def standard_deviations(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    def to_dict(self) -> list[dict[str, Any]]: ...

@final
class DriveGains:
    @property
    def gains(self) -> _Array: ...
    @property
    def standard_deviations(self) -> _Array: ...
    @property
    def payload(self) -> _Array: ...

def identify_payload(
    robot: Robot,
    unloaded: _Logs,
    loaded: _Logs,
    *,
    link: str | None = None,
    friction_may_change: bool = False,
    consistent: bool = True,
    **options: Unpack[_PayloadOptions],
) -> Payload: ...
def identify_drive_gains(
    robot: Robot,
    unloaded: _Logs,
    loaded: _Logs,
    *,
    payload: Mapping[str, float],
    link: str | None = None,
    estimator: Literal["maximum_likelihood", "total_least_squares", "least_squares"] = "maximum_likelihood",
    lowest: ArrayLike | None = None,
    **options: Unpack[_GainOptions],
) -> DriveGains: ...
def repeated_share(known: _Logs, new: Recording) -> float | None: ...
def shared_samples(known: _Logs, new: Recording) -> list[tuple[int, int, int]]: ...
def screen(model: Model, recordings: _Logs) -> list[str]: ...
def regroupings(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]: ...

@final
class JointComparison:
    @property
    def joint(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def samples(self) -> int: ...
    @property
    def rmse(self) -> float: ...
    @property
    def fit_percent(self) -> float: ...
    @property
    def r2(self) -> float: ...
    @property
    def relative_error_percent(self) -> float: ...
    @property
    def largest_error(self) -> float: ...
    @property
    def largest_error_log(self) -> str: ...
    @property
    def largest_error_time(self) -> float: ...
    @property
    def rmse_zero(self) -> float: ...
    @property
    def rmse_gravity(self) -> float: ...
    @property
    def rmse_full_band(self) -> float: ...
    @property
    def rmse_with_rests(self) -> float: ...
    @property
    def relative_error_with_rests_percent(self) -> float: ...

@final
class LogResidual:
    @property
    def source(self) -> str: ...
    @property
    def time_ns(self) -> NDArray[np.int64]: ...
    @property
    def t(self) -> _Array: ...
    @property
    def measured(self) -> _Array: ...  # (N, n), as all below
    @property
    def predicted(self) -> _Array: ...
    @property
    def measured_in_band(self) -> _Array: ...
    @property
    def predicted_in_band(self) -> _Array: ...
    @property
    def counted(self) -> NDArray[np.bool_]: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def q(self) -> _Array: ...
    @property
    def dq(self) -> _Array: ...
    @property
    def ddq(self) -> _Array: ...

@final
class Comparison:
    @property
    def joints(self) -> list[JointComparison]: ...
    @property
    def relative_error_percent(self) -> float: ...
    @property
    def relative_error_with_rests_percent(self) -> float: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def logs(self) -> list[LogResidual]: ...
    # columns over the joints, (n,)
    @property
    def rmse(self) -> _Array: ...
    @property
    def fit_percent(self) -> _Array: ...
    @property
    def r2(self) -> _Array: ...
    def report(self, path: _Path) -> None: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def to_dict(self) -> dict[str, Any]: ...  # figures only, ready for json: None where there is no number
    def _repr_html_(self) -> str: ...

def compare(
    model: Model | Robot,
    recordings: _Logs,
    *,
    processing: Model | Processing | None = None,  # default: as the model was identified, else chosen from the logs
) -> Comparison: ...
def compare_streaming(
    model: Model | Any,  # or a SemiParametricModel
    recordings: _Logs,
    *,
    processing: Model | Processing | None = None,
    causal: bool = False,
) -> Comparison: ...
def load(path: _Path) -> Model: ...

@final
class Kernel:
    def __new__(
        cls,
        shape: str,
        inputs: Sequence[int],
        length_scale: ArrayLike = 1.0,
        *,
        variance: float = 1.0,
        mixture: float = 1.0,
        periods: Mapping[int, float] | None = None,
    ) -> Kernel: ...
    @property
    def theta(self) -> _Array: ...
    @property
    def names(self) -> list[str]: ...
    def with_theta(self, theta: ArrayLike) -> Kernel: ...
    def to_json(self) -> str: ...
    @staticmethod
    def from_json(text: str) -> Kernel: ...
    def __add__(self, other: Kernel, /) -> Kernel: ...
    def __radd__(self, other: Kernel, /) -> Kernel: ...
    def __mul__(self, other: Kernel, /) -> Kernel: ...
    def __rmul__(self, other: Kernel, /) -> Kernel: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __call__(self, X: ArrayLike, Y: ArrayLike | None = None) -> _Array: ...

@final
class FittedProcess:
    def predict(self, X: ArrayLike, with_std: bool) -> tuple[_Array, _Array | None]: ...
    def log_marginal_likelihood(self, theta: ArrayLike, eval_gradient: bool) -> tuple[float, _Array | None]: ...
    @property
    def log_marginal_likelihood_value(self) -> float: ...
    def leave_one_out(self) -> tuple[_Array, _Array, float]: ...
    def calibration(self) -> tuple[_Array, _Array]: ...
    @property
    def theta(self) -> _Array: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def kernel(self) -> Kernel: ...
    @property
    def noise_variance(self) -> float: ...
    @property
    def inducing(self) -> _Array | None: ...
    @property
    def report(self) -> dict[str, Any]: ...
    def predictor(self, single: bool, variance_rank: int | None, compact: bool) -> ProcessPredictor: ...

@final
class ProcessPredictor:
    """One point after the other, for a control loop."""

    def mean(self, x: ArrayLike) -> _Array: ...
    def mean_and_std(self, x: ArrayLike) -> tuple[_Array, float, bool]: ...
    @property
    def error(self) -> float: ...
    @property
    def variance_error(self) -> float: ...

def fit_process(X: ArrayLike, y: ArrayLike, **options: Any) -> tuple[FittedProcess, BaseException | None]: ...
def restore_process(
    x: ArrayLike, y: ArrayLike, covariance: str, inducing: ArrayLike | None, threads: int
) -> FittedProcess: ...

@final
class FittedSemiParametric:
    @staticmethod
    def load(path: _Path) -> FittedSemiParametric: ...
    def save(self, path: _Path) -> None: ...
    @property
    def physics(self) -> Model: ...
    @property
    def mean(self) -> str: ...
    @property
    def stopped(self) -> bool: ...
    def predict(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, with_std: bool
    ) -> tuple[_Array, list[_Array] | None]: ...  # std, half the interval of 95 %, novelty
    def compare(self, recordings: _Logs) -> Comparison: ...
    def compare_with_spread(
        self, recordings: _Logs
    ) -> tuple[Comparison, list[list[_Array]]]: ...  # std, half the interval of 95 %, novelty of each log
    def score(self, recordings: _Logs) -> float: ...
    def coverage(self, recordings: _Logs, following: bool) -> list[dict[str, Any]]: ...
    @property
    def reports(self) -> list[dict[str, Any]]: ...
    def predictor(
        self, numbers: tuple[bool, int | None, bool], stream: tuple[float | None, str, list[str]]
    ) -> SemiParametricPredictor: ...
    def to_bytes(self) -> bytes: ...
    @staticmethod
    def from_bytes(data: bytes) -> FittedSemiParametric: ...

@final
class SemiParametricPredictor:
    """One sample after the other, for a control loop."""

    @property
    def purpose(self) -> _Purpose: ...
    @property
    def novelty(self) -> _Array: ...
    def reset(self, q: ArrayLike | None = None, dq: ArrayLike | None = None, *, time: float = 0.0) -> None: ...
    def set_temperature(self, celsius: ArrayLike) -> None: ...
    def torque(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _Array: ...
    def torque_and_std(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> tuple[_Array, _Array]: ...

def fit_semi_parametric(
    robot: Robot,
    recordings: _Logs,
    *,
    physics: Model | None,
    mean: str,
    kernel: str,
    ard: bool,
    inputs: str | None,
    shared: bool,
    points: int,
    sparse: bool | None,
    starts: int,
    max_evaluations: int,
    n_jobs: int,
    options: dict[str, Any],
) -> tuple[FittedSemiParametric, BaseException | None]: ...
def puma560() -> Robot: ...
def two_link() -> Robot: ...

@final
class Trajectory:
    @staticmethod
    def fourier(robot: Robot, fundamental_hz: float, a: ArrayLike, b: ArrayLike) -> Trajectory: ...
    @staticmethod
    def random(
        robot: Robot, *, start: ArrayLike | None = None, random_state: int = 0, **options: Unpack[_MotionOptions]
    ) -> Trajectory: ...
    @property
    def duration(self) -> float: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def coefficients(self) -> _Array: ...
    @property
    def start(self) -> _Array: ...
    def scaled(self, factor: float) -> Trajectory: ...
    def at(self, t: ArrayLike) -> tuple[_Array, _Array, _Array]: ...
    def samples(self, rate_hz: float, duration: float | None = None) -> tuple[_Array, _Array, _Array, _Array]: ...
    def excitation(
        self, effects: Sequence[str] = (), *, noise: ArrayLike | None = None, rate_hz: float = 100.0
    ) -> dict[str, Any]: ...
    def peaks(self) -> dict[str, _Array]: ...
    def save_csv(self, path: _Path, rate_hz: float = 100.0) -> None: ...
    def save_mcap(self, path: _Path, rate_hz: float = 100.0, topic: str = "/joint_trajectory") -> None: ...

@final
class Excitation:
    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def criterion(self) -> str: ...
    @property
    def value(self) -> float: ...
    @property
    def values(self) -> _Array: ...
    @property
    def report(self) -> dict[str, Any]: ...
    @property
    def peaks(self) -> dict[str, _Array]: ...
    @property
    def forecast(self) -> dict[str, Any]: ...  # seconds, deviation, noise, enough_at, seconds_to_go, advice
    @property
    def utilisation(self) -> float: ...
    @property
    def tightest(self) -> str: ...
    @property
    def history(self) -> _Array: ...
    @property
    def status(self) -> Literal["finished", "interrupted"]: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def save_report(self, path: _Path) -> None: ...
    def _repr_html_(self) -> str: ...

def excite(
    robot: Robot,
    effects: Sequence[str] = ("viscous_friction", "coulomb_friction"),
    *,
    criterion: str = "condition",
    start: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    model: Model | None = None,
    starts: int = 6,
    max_evaluations: int = 1500,
    random_state: int = 0,
    n_jobs: int | None = None,
    progress: _Progress | None = None,
    **options: Unpack[_ExcitationOptions],
) -> Excitation: ...

@final
class Drive:
    def __new__(
        cls,
        *,
        rotor_inertia: float = 0.0,
        viscous_friction: float = 0.0,
        coulomb_friction: float | tuple[float, float] = 0.0,
        static_friction: float | tuple[float, float] | None = None,
        stribeck_velocity: float = 0.0,
    ) -> Drive: ...
    @property
    def rotor_inertia(self) -> float: ...
    @property
    def viscous_friction(self) -> float: ...
    @property
    def coulomb_friction(self) -> tuple[float, float]: ...
    @property
    def static_friction(self) -> tuple[float, float]: ...
    @property
    def stribeck_velocity(self) -> float: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __lt__(self, other: object, /) -> bool: ...
    def __le__(self, other: object, /) -> bool: ...
    def __gt__(self, other: object, /) -> bool: ...
    def __ge__(self, other: object, /) -> bool: ...

def puma560_drives() -> list[Drive]: ...
def two_link_drives() -> list[Drive]: ...

@final
class Simulation:
    @property
    def t(self) -> _Array: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def q(self) -> _Array: ...
    @property
    def dq(self) -> _Array: ...
    @property
    def ddq(self) -> _Array: ...
    @property
    def tau(self) -> _Array: ...
    @property
    def friction(self) -> _Array: ...
    @property
    def q_measured(self) -> _Array: ...
    @property
    def dq_measured(self) -> _Array: ...
    @property
    def tau_measured(self) -> _Array: ...
    @property
    def q_wanted(self) -> _Array: ...
    @property
    def dq_wanted(self) -> _Array: ...
    @property
    def ddq_wanted(self) -> _Array: ...
    @property
    def tracking_rmse(self) -> _Array: ...
    def recording(self, source: str = "simulation") -> Recording: ...
    def plot(self) -> Any: ...  # plotly.graph_objects.Figure
    def report(self, path: _Path) -> None: ...
    def _repr_html_(self) -> str: ...
    def __len__(self) -> int: ...

_Known = Robot | Model | SemiParametricModel | Sequence[Robot | Model | SemiParametricModel]
_Controller = Callable[[float, _Array, _Array, _Array, _Array, _Array], ArrayLike]

def simulate(
    robot: Robot | Model,
    reference: Trajectory | ArrayLike | tuple[float, ArrayLike, ArrayLike, ArrayLike],
    *,
    duration: float | None = None,
    controller: Literal["feed_forward", "computed_torque", "impedance", "pd"] | _Controller = "feed_forward",
    kp: ArrayLike = 75.0,
    kd: ArrayLike = 5.0,
    model: _Known | None = None,
    feed_forward: ArrayLike | None = None,
    drives: Sequence[Drive] | None = None,
    integrator: Literal["euler", "runge_kutta"] = "euler",
    step: float = 2.5e-4,
    control_period: float = 1e-3,
    record_period: float | None = None,
    delay: float = 0.0,
    position_resolution: ArrayLike | None = None,
    position_noise: ArrayLike | None = None,
    torque_noise: ArrayLike | None = None,
    actuation_noise: ArrayLike | None = None,
    velocity: Literal["exact", "difference"] = "exact",
    torque_limits: ArrayLike | None = None,
    speed_limit: float = 1000.0,
    pick_up: tuple[float, ArrayLike] | None = None,
    random_state: int = 0,
    progress: _Progress | None = None,
) -> Simulation: ...

@final
class OnlineModel:
    """An identified model that follows what changes while the arm runs."""

    def __new__(
        cls,
        robot: Robot,
        model: _Known | None = None,
        *,
        payload: bool = True,
        process: bool = True,
        link: str | None = None,
        mass: float = 5.0,
        radius: float = 0.2,
        memory: float = 0.3,
        noise: ArrayLike | None = None,
        points: int = 100,
        novelty: float = 0.03,
        process_memory: float = 2.0,
        period: float = 0.001,
        cutoff_hz: float = 10.0,
        standstill_speed: float = 0.02,
    ) -> OnlineModel: ...
    def update(self, q: ArrayLike, tau: ArrayLike) -> None: ...
    def torque(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _Array: ...
    @property
    def payload(self) -> _Array | None: ...
    @property
    def payload_std(self) -> _Array | None: ...
    @property
    def points(self) -> int: ...

@final
class OnlineGaussianProcess:
    """A Gaussian process whose points come and go."""

    def __new__(
        cls,
        kernel: Kernel,
        inputs: int,
        outputs: int = 1,
        *,
        noise_variance: float = 0.01,
        points: int = 100,
        novelty: float = 0.03,
        refresh: int = 100,
        memory: int = 2000,
    ) -> OnlineGaussianProcess: ...
    def add(self, x: ArrayLike, y: ArrayLike) -> None: ...
    @overload
    def predict(self, x: ArrayLike, return_std: Literal[False] = False) -> _Array: ...
    @overload
    def predict(self, x: ArrayLike, return_std: Literal[True]) -> tuple[_Array, float]: ...
    def __len__(self) -> int: ...
