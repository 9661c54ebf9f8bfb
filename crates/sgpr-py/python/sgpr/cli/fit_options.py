"""How to identify: options that commands share."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import estimators
from .effects import effects_option, fitted_effects
from .errors import BadData, one_of, wrong_use

FIT = "Identification"
BODIES = "Physical consistency"
EQUATIONS = "Equations"
MOST_REPLICATES = 100_000


def _estimators() -> str:
    """The estimators beyond least squares, in words."""
    settings = {e["name"]: f" or {e['name']}:{e['setting']}" if e["setting"] else "" for e in estimators()}
    return "; ".join(f"{e['title']} ({e['name']}{settings[e['name']]})" for e in estimators())


@dataclass(frozen=True)
class EquationOptions:
    """What is in the equations, and how logs become equations."""

    effects: Annotated[
        list[str] | None,
        effects_option(
            "Effects beside the rigid body, at all joints or as EFFECT@JOINT at one, or `none`.", panel=EQUATIONS
        ),
    ] = None
    cutoff: Annotated[
        float | None,
        typer.Option(
            "--cutoff",
            metavar="HZ",
            help="Low-pass of the positions.",
            show_default="from spectra",
            rich_help_panel=EQUATIONS,
        ),
    ] = None
    order: Annotated[int, typer.Option("--order", help="Order of the low-pass.", rich_help_panel=EQUATIONS)] = 4
    differentiation: Annotated[
        str,
        typer.Option(
            "--differentiation",
            help="central, central:4, savitzky_golay:WINDOW:DEGREE.",
            rich_help_panel=EQUATIONS,
        ),
    ] = "central"
    torque_band: Annotated[
        str,
        typer.Option(
            "--torque-band",
            metavar="HZ|position|full",
            help="Low-pass of both sides of the equation: as the positions, none (full), or a cut-off.",
            rich_help_panel=EQUATIONS,
        ),
    ] = "position"
    decimation: Annotated[
        int | None,
        typer.Option(
            "--decimation", help="Take every so many rows.", show_default="from the cut-off", rich_help_panel=EQUATIONS
        ),
    ] = None
    standstill_speed: Annotated[
        float | None,
        typer.Option(
            "--standstill-speed",
            metavar="SPEED",
            help="Slower joints count as standing, rad/s.",
            show_default="from the noise",
            rich_help_panel=EQUATIONS,
        ),
    ] = None
    turn_margin: Annotated[
        float,
        typer.Option(
            "--turn-margin",
            metavar="PERIODS",
            help="Periods of the cut-off about each turn of a joint in which its rows do not count.",
            rich_help_panel=EQUATIONS,
        ),
    ] = 0.0

    def arguments(self) -> dict[str, Any]:
        """What `sgpr.identify` takes."""
        for value, option in ((self.cutoff, "--cutoff"), (self.standstill_speed, "--standstill-speed")):
            if value is not None and not value > 0.0:
                raise wrong_use("must be greater than zero", option)
        for count, option in ((self.order, "--order"), (self.decimation, "--decimation")):
            if count is not None and count < 1:
                raise wrong_use("must be at least 1", option)
        if not 0.0 <= self.turn_margin < float("inf"):
            raise wrong_use("must be zero or more", "--turn-margin")
        return {
            "effects": fitted_effects(self.effects),
            "cutoff_hz": self.cutoff,
            "filter_order": self.order,
            "differentiation": self.differentiation,
            "torque_band": self._band(),
            "decimation": self.decimation,
            "standstill_speed": self.standstill_speed,
            "turn_margin": self.turn_margin,
        }

    def _band(self) -> float | str:
        if self.torque_band in ("position", "full"):
            return self.torque_band
        try:
            hz = float(self.torque_band)
        except ValueError:
            hz = 0.0
        if not hz > 0.0:
            raise wrong_use(
                f"`{self.torque_band}` is neither a cut-off in Hz nor `position` or `full`", "--torque-band"
            )
        return hz


@dataclass(frozen=True)
class BodyOptions:
    """Whether links are bodies, and which."""

    consistent: Annotated[
        bool | None,
        typer.Option(
            "--consistent/--no-consistent",
            help="Every link a body, friction and rotors not negative.",
            show_default=False,
            rich_help_panel=BODIES,
        ),
    ] = None
    prior: Annotated[
        str | None,
        typer.Option(
            "--prior",
            metavar="entropic|euclidean",
            help="With --consistent: how the distance to the robot file is measured where the data are silent.",
            show_default="entropic",
            rich_help_panel=BODIES,
        ),
    ] = None
    prior_deviation: Annotated[
        str | None,
        typer.Option(
            "--prior-deviation",
            metavar="SHARE|auto",
            help="Relative standard deviation of the robot file's values; auto: the data choose. See --no-prior.",
            show_default="auto; with --consistent 30",
            rich_help_panel=BODIES,
        ),
    ] = None
    bounds: Annotated[
        str | None,
        typer.Option(
            "--bounds",
            metavar="FILE",
            help='With --consistent: limits in JSON, {"joint_2": {"mass": [1, 5], "box": [[...], [...]]}, '
            '"total_mass": [20, 30], "joint_2.Fv": [0, null]}.',
            rich_help_panel=BODIES,
        ),
    ] = None

    def arguments(self, *, default: bool = False, others: tuple[str, ...] = ()) -> dict[str, Any]:
        """What `sgpr.identify` takes.

        `default` is what holds where nothing is said; the options named in `others` have a meaning without bodies, too.
        """
        consistent = default if self.consistent is None else self.consistent
        for option, value in self.given():
            if not consistent and value is not None and option not in others:
                raise wrong_use("belongs to --consistent", option)
        if self.prior is not None:
            one_of(self.prior, ("entropic", "euclidean"), "--prior", "distance")
        return {
            "consistent": consistent,
            # None would be no prior at all.
            **({} if self.prior is None else {"prior": self.prior}),
            "prior_deviation": self._prior_deviation(),
            "bounds": None if self.bounds is None else _read_bounds(self.bounds),
        }

    def given(self) -> list[tuple[str, Any]]:
        """Options that say more of bodies, and their values."""
        return [("--prior", self.prior), ("--prior-deviation", self.prior_deviation), ("--bounds", self.bounds)]

    def _prior_deviation(self) -> float | str | None:
        if self.prior_deviation is None or self.prior_deviation == "auto":
            return self.prior_deviation
        if not _is_number(self.prior_deviation) or not float(self.prior_deviation) > 0.0:
            raise wrong_use(f"`{self.prior_deviation}`: expected a number above zero, or auto", "--prior-deviation")
        return float(self.prior_deviation)


@dataclass(frozen=True)
class IdentificationOptions:
    """How parameters are estimated."""

    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="METHOD",
            help=f"Ordinary or weighted least squares (ols, wls); {_estimators()}.",
            rich_help_panel=FIT,
        ),
    ] = "wls"
    instruments: Annotated[
        list[str] | None,
        typer.Option(
            "--instruments",
            metavar="FILE...",
            help="For iv: logs of the same motions without noise, such as references, one for each training log. "
            "With --kp and --kd: the references of the controller.",
            rich_help_panel=FIT,
        ),
    ] = None
    kp: Annotated[
        list[float] | None,
        typer.Option(
            "--kp",
            metavar="GAIN...",
            help="For output_error, and iv with simulated instruments: gains of the controller by joint, N·m/rad.",
            rich_help_panel=FIT,
        ),
    ] = None
    kd: Annotated[
        list[float] | None,
        typer.Option("--kd", metavar="GAIN...", help="And of its damping, N·m·s/rad.", rich_help_panel=FIT),
    ] = None
    essential: Annotated[
        bool,
        typer.Option("--essential", help="Leave out what the data do not support.", rich_help_panel=FIT),
    ] = False
    uncertainty: Annotated[
        str,
        typer.Option(
            "--uncertainty",
            metavar="memory|hac|bootstrap",
            help="Where standard deviations come from: the memory of each joint's residual, residuals correlated over "
            "time and joints, or blocks of the logs drawn again (bootstrap:REPLICATES).",
            rich_help_panel=FIT,
        ),
    ] = "memory"
    no_prior: Annotated[
        bool,
        typer.Option(
            "--no-prior",
            help="The bare estimate: what the logs hardly determine is not held by the robot file, nor do joints keep "
            "the file where it predicts better.",
            rich_help_panel=FIT,
        ),
    ] = False
    start: Annotated[
        str,
        typer.Option(
            "--start",
            metavar="robot_file|zero",
            help="What parameters that the motion does not excite keep: the robot file's values; or zero, if the "
            "torque in the logs is what an internal model leaves over.",
            rich_help_panel=FIT,
        ),
    ] = "robot_file"

    def arguments(self) -> dict[str, Any]:
        """What `sgpr.identify` takes, without the instruments, which are logs."""
        needs = next((e["needs"] for e in estimators() if e["name"] == self.method), None)
        for option, value in (("--instruments", self.instruments), ("--kp", self.kp), ("--kd", self.kd)):
            if value is not None and needs not in ("instruments", "controller"):
                names = " or ".join(e["name"] for e in estimators() if e["needs"] in ("instruments", "controller"))
                raise wrong_use(f"belongs to --method {names}", option)
        if (self.kp is None) != (self.kd is None):
            raise wrong_use(
                "a controller has both; zeros where it has no such gain", "--kp" if self.kp is None else "--kd"
            )
        if needs in ("instruments", "controller") and not self.instruments:
            raise wrong_use(f"{self.method} needs the references or instruments of the training logs", "--instruments")
        if needs == "controller" and self.kp is None:
            raise wrong_use(f"{self.method} simulates the arm under its controller: give its gains", "--kp")
        return {
            "method": self._method(),
            "essential": self.essential,
            "uncertainty": self._uncertainty(),
            "start": one_of(self.start, ("robot_file", "zero"), "--start", "start"),
            **({} if self.kp is None else {"kp": self.kp, "kd": self.kd}),
            **({"prior": None} if self.no_prior else {}),
        }

    def _method(self) -> str:
        name, _, setting = self.method.partition(":")
        one_of(name, ("ols", "wls", *(e["name"] for e in estimators())), "--method", "method")
        with_number = [e["name"] for e in estimators() if e["setting"]]
        if setting and (name not in with_number or not _is_number(setting)):
            known = f"{', '.join(with_number[:-1])} and {with_number[-1]}"
            raise wrong_use(f"`{self.method}`: only {known} have a number", "--method")
        return self.method

    def _uncertainty(self) -> str:
        name, _, count = self.uncertainty.partition(":")
        one_of(name, ("memory", "hac", "bootstrap"), "--uncertainty", "source of standard deviations")
        if count and not (name == "bootstrap" and count.isdigit() and 2 <= int(count) <= MOST_REPLICATES):
            raise wrong_use(f"`{self.uncertainty}`: only bootstrap has a number, from 2 on", "--uncertainty")
        return self.uncertainty


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_bounds(path: str) -> dict[str, Any]:
    try:
        bounds = json.loads(Path(path).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{path}: no JSON: {error}") from error
    if not isinstance(bounds, dict):
        raise BadData(f"{path}: expected an object of limits by joint or parameter")
    return bounds
