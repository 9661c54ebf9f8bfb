"""The tables as a Markdown page: the thesis's numbers beside ours, row by row."""

import os
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import published
from .experiments import (
    IDENTIFIED,
    IDENTIFIED_ALL,
    INTERNAL,
    NON_PARAMETRIC,
    SEMI_PARAMETRIC,
    SEMI_PARAMETRIC_ALL,
    Settings,
    Thesis,
)

HEAD = """# The thesis, run again

`sgpr reproduce thesis` runs the experiments of S. Krishnamoorthi, *Model-Based Compensation for Serial Manipulators
through Semi-Parametric Gaussian Process Regression*, MSc thesis, TU Delft (2018), and writes this page. Tables and
sections are numbered as there. The experiments are a package of their own, `examples/thesis` in the repository.

Choices where the thesis is silent: gains act at the joints (see below), dry friction has a stiction of 1.05 times the
Coulomb friction that falls off around 0.05 rad/s, encoders have steps of 1e-5 rad, and every motion starts and ends at
rest. Logs are the mean of the periods after the first.

Models, all from the same logs: *internal*, the rigid body alone ("Corke's IDM"); *identified*, the parameters of the
thesis (base parameters, viscous and Coulomb friction) by least squares that weigh outliers down; *semi-parametric*, the
same and a Gaussian process per joint of its position, velocity and acceleration, estimated together (generalised least
squares, hyperparameters by the likelihood of what the parameters cannot explain); *non-parametric*, processes of all 18
inputs (6 for the two-link arm) alone. *All effects* adds rotor inertia and an offset to the parameters, which the
thesis leaves to the process. A process beside parameters is kept only where both together predict parts of the log that
were left out better than the identified parameters do, by more than a standard error.
"""

SHORT = """This page is of the short version (`--short`): one search per criterion, two periods of 10 s, processes of
120 points.
"""


def markdown(thesis: Thesis) -> str:
    """The page."""
    parts = (_excitation, _case_1, _kernels, _study, _case_2, _beyond)
    head = HEAD if thesis.settings != Settings.short() else f"{HEAD}\n{SHORT}"
    return "\n".join([head, *(text for part in parts for text in part(thesis))])


def _excitation(thesis: Thesis) -> Iterable[str]:
    yield "## Excitation trajectories (chapter 3, tables C-1 and C-2)\n"
    yield _text(
        "The printed amplitudes, evaluated with our regressors, against motions found under the same limits, "
        "number of terms and frequency. The printed series do not start at rest, as eqs. 3-5 and 3-6 demand; "
        "ours do. Smaller is better in every row; D-optimality is -log det per sample."
    )
    rows = []
    for name, found in thesis.data["excitation"].items():
        for row in found["rows"]:
            columns = "with friction" if row["friction_columns"] else "without friction"
            rows.append(
                [
                    name,
                    columns,
                    row["criterion"],
                    _number(row["published"]),
                    _number(row["found"]),
                    f"{100 * row['utilisation']:.5f} %",
                    f"{row['seconds']:.0f}",
                ]
            )
    titles = ["robot", "columns", "criterion", "thesis's amplitudes", "found", "of the tightest limit", "s"]
    yield _table(titles, rows)
    every = [row for found in thesis.data["excitation"].values() for row in found["rows"]]
    beaten = sum(row["found"] < row["published"] for row in every)
    yield _text(
        f"The thesis's amplitudes are beaten in {beaten} of {len(every)} rows, each within "
        f"{max(row['seconds'] for row in every):.0f} s on {os.cpu_count()} cores. Limits hold in continuous time: the "
        f"largest share of any limit, refined between samples, is {max(row['utilisation'] for row in every):.9f}."
    )


def _case_1(thesis: Thesis) -> Iterable[str]:
    yield "## Case 1: the internal model replaced by the identified one (section 5-3-1)\n"
    rows = [
        [
            name,
            str(found["base_parameters"]),
            str(found["samples"]),
            _number(found["published_condition"]),
            _number(found["condition"]),
        ]
        for name, found in thesis.data["case_1"].items()
    ]
    yield _table(["robot", "parameters", "samples", "cond(W), thesis", "cond(W), ours"], rows)
    yield _text(
        "Position error at test gains (Kp 10 N·m/rad, Kd 0.2 N·m·s/rad), root mean square over ten seconds, "
        "rad. The thesis prints these as figures 5-6 to 5-9 without numbers; its ordering is internal worse than "
        "identified, identified worse than or as good as semi-parametric, the first three joints most."
    )
    rows = []
    for name, found in thesis.data["case_1"].items():
        rows += [[name, run["motion"], run["model"], _numbers(run["rmse"])] for run in found["tracking"]]
    yield _table(["robot", "motion", "model", "error of joint 1, 2, ... [rad]"], rows)
    for better, worse in ORDER:
        yield _text(_ordering(thesis, better, worse))
    yield "### At which side the gains act\n"
    rows = [
        [name, side, _numbers(errors)]
        for name, found in thesis.data["case_1"].items()
        for side, errors in found["gain_sides"].items()
    ]
    yield _table(["robot", "gains at the", "error under the internal model [rad]"], rows)
    yield _text(
        "Errors of tenths of a radian, as in table 5-8, come from gains at the joints and the unit rad. Gains "
        "at the motors, times gear ratio squared at the joints, leave less than a thousandth of that."
    )


# A model that claims to follow better than another.
ORDER = (
    (IDENTIFIED, INTERNAL),
    (SEMI_PARAMETRIC, IDENTIFIED),
    (SEMI_PARAMETRIC, NON_PARAMETRIC),
    (SEMI_PARAMETRIC_ALL, IDENTIFIED_ALL),
)

# Sums of errors over three motions that differ by less are alike.
HARM = 1.05

# Equal to a tenth of a milliradian is equal.
EQUAL = 1e-4


def exceptions(tracking: Sequence[dict[str, Any]], better: str, worse: str) -> tuple[list[str], list[str]]:
    """Motions on which the model `better` has the larger sum of errors, and single joints."""
    errors: dict[str, dict[str, Any]] = {}
    for run in tracking:
        errors.setdefault(run["motion"], {})[run["model"]] = np.asarray(run["rmse"])
    sums, joints = [], []
    for motion, each in errors.items():
        difference = each[better] - each[worse]
        if difference.sum() > EQUAL:
            sums.append(motion)
        joints += [
            f"{motion} joint {k + 1} ({_change(each[better][k], each[worse][k])})"
            for k in np.flatnonzero(difference > EQUAL)
        ]
    return sums, joints


def _ordering(thesis: Thesis, better: str, worse: str) -> str:
    sums, joints = [], []
    count = 0
    for name, found in thesis.data["case_1"].items():
        of_sums, of_joints = exceptions(found["tracking"], better, worse)
        sums += [f"{name} {each}" for each in of_sums]
        joints += [f"{name} {each}" for each in of_joints]
        motions = len(found["tracking"]) // len({run["model"] for run in found["tracking"]})
        count += motions * len(found["tracking"][0]["rmse"])
    where = f"but {', '.join(sums)}" if sums else "without exception"
    text = f"*{better}* follows at least as well as *{worse}* (sum over joints) on all motions {where}"
    if not joints:
        return f"{text}, and at every single joint ({count} of {count})."
    listed = f": {', '.join(joints)}" if len(joints) <= 6 else ""
    return f"{text}; at single joints in {count - len(joints)} of {count} cases, worse at {len(joints)}{listed}."


def _kernels(thesis: Thesis) -> Iterable[str]:
    yield "## One length scale or one per input (figures 5-10 and 5-11)\n"
    yield _text(
        "Two-link arm, trained on the D-optimal motion. The thesis finds ARD better on the training and on the test "
        "motion; its inputs are all positions, velocities and accelerations."
    )
    rows = [[run["motion"], run["model"], _numbers(run["rmse"])] for run in thesis.data["kernels"]]
    yield _table(["motion", "model", "error of joint 1, 2 [rad]"], rows)


def _study(thesis: Thesis) -> Iterable[str]:
    yield "## Eight training sets (section 5-3-3, table 5-8)\n"
    yield _text(
        "Mean position error over three test motions at test gains, PUMA 560, joints 1 to 6 and their sum, rad. "
        "The thesis's rows are semi-parametric models, unit not printed."
    )
    table = thesis.data["table_5_8"]
    rows = []
    for row in table:
        for label, values in (("thesis", row["published"]), *row["errors"].items()):
            rows.append([row["motion"], label, *(_number(value) for value in values), _number(np.sum(values))])
    yield _table(["trained on", "", "1", "2", "3", "4", "5", "6", "sum"], rows)
    labels = list(table[0]["errors"])
    for better, worse in ((SEMI_PARAMETRIC, IDENTIFIED), (SEMI_PARAMETRIC_ALL, IDENTIFIED_ALL)):
        counted, lost = _lost(table, "errors_of_tests", better, worse, EQUAL)
        yield _text(
            f"*{better}* is at least as good as *{worse}* at {counted - len(lost)} of {counted} joints of test "
            f"motions{_listed(lost)}."
        )
        counted, of_torque = _lost(table, "torque_errors_of_tests", better, worse, EQUAL * published.TEST_GAINS[0])
        yield _text(
            "The torque that it feeds forward along these motions, against what the machine needs, nothing followed, "
            f"is at least as good at {counted - len(of_torque)} of {counted} joints{_listed(of_torque)}."
        )
        by_the_loop = [joint for joint in lost if joint not in of_torque]
        if by_the_loop:
            yield _text(
                f"At {len(by_the_loop)} of the {len(lost)} joints that lose position the torque is not worse: "
                f"{'; '.join(by_the_loop)}. Weak gains leave a joint to what the others do and to where dry friction "
                "lets it stick."
            )
    yield _text(
        "What the high-frequency series changes, sum of errors. In rows 3 and 7 of the thesis it makes the models "
        "worse, which the thesis puts down to over-fitting. It turns the joints all the time. At a turn dry friction "
        "jumps, a sample at 60 Hz stands on either side of the jump, and the filters spread the error over a period "
        "of the cut-off; below 0.05 rad/s stiction and the Stribeck slope rule. No model here describes that. Slow "
        "rows and those within a period of a turn are left out of all logs, and what outliers remain are weighed down."
    )
    changes: list[list[str]] = []
    hurt: dict[str, list[str]] = {label: [] for label in labels}
    for row in table:
        before = next((other for other in table if f"HFS + {other['motion']}" == row["motion"]), None)
        if before is not None:
            printed = _change(sum(row["published"]), sum(before["published"]))
            sums = {label: (np.sum(row["errors"][label]), np.sum(before["errors"][label])) for label in labels}
            for label, (after, alone) in sums.items():
                if after > HARM * alone:
                    most = _most_changed(before["errors"][label], row["errors"][label])
                    floor = " and ".join(_number(_sum(each, IDENTIFIED_ALL)) for each in (before, row))
                    hurt[label].append(
                        f"{row['motion']}: sum {_number(alone)} to {_number(after)} rad where *{IDENTIFIED_ALL}* has "
                        f"{floor}, {most}"
                    )
            changes.append([row["motion"], printed, *(_change(*sums[label]) for label in labels)])
    yield _table(["", "thesis", *labels], changes)
    for label, motions in hurt.items():
        by = f"by more than {100.0 * (HARM - 1.0):.0f} %"
        where = f"hurts *{label}* {by} in {'; '.join(motions)}" if motions else f"never hurts *{label}* {by}"
        yield _text(f"The series {where}.")
    yield from _terms(table)
    yield from _other_series(thesis, table)
    follows = [row["motion"] for row in table if _sum(row, SEMI_PARAMETRIC) < _sum(row, IDENTIFIED)]
    yield _text(
        f"The sum of *{SEMI_PARAMETRIC}* is below that of *{IDENTIFIED}* in {len(follows)} of {len(table)} rows. Its "
        "processes know no outliers, and rows in which dry friction turns between two samples would count in full: "
        "taken for errors that last for a while, which predictions leave out, or for a function of the motion."
    )


def _lost(
    table: Sequence[dict[str, Any]], errors: str, better: str, worse: str, equal: float
) -> tuple[int, dict[str, str]]:
    """Number of joints of test motions, and those at which the model `better` has the larger error, by how much.

    - `equal`: a difference that is none
    """
    counted, lost = 0, {}
    for row in table:
        for k, (one, other) in enumerate(zip(row[errors][better], row[errors][worse], strict=True)):
            counted += len(one)
            for joint in np.flatnonzero(np.asarray(one) - np.asarray(other) > equal):
                lost[f"{row['motion']}, test {k + 1}, joint {joint + 1}"] = _change(one[joint], other[joint])
    return counted, lost


def _listed(lost: dict[str, str]) -> str:
    """The joints that lose, if they are few."""
    named = [f"{joint} ({change})" for joint, change in lost.items()]
    return f": {'; '.join(named)}" if 0 < len(named) <= 8 else ""


def _terms(table: Sequence[dict[str, Any]]) -> Iterable[str]:
    """Which of the missing parameters the errors are from."""
    terms = list(table[0]["with_term"])
    labels = [IDENTIFIED, *(f"and {term.replace('_', ' ')}" for term in terms), IDENTIFIED_ALL]
    rows = []
    for row in table:
        sums = [_sum(row, IDENTIFIED), *(row["with_term"][term] for term in terms), _sum(row, IDENTIFIED_ALL)]
        rows.append([row["motion"], *map(_number, sums)])
    yield _text(
        "Where the errors of *identified* are from: sum of errors with one of the missing parameters added. Least "
        "squares spreads a missing one over the others, differently for each training set; that a second log lowers "
        "the error is certain only where nothing is missing."
    )
    yield _table(["trained on", *labels], rows)


def _most_changed(before: NDArray[np.float64], after: NDArray[np.float64]) -> str:
    """The joint at which an error grows most."""
    joint = int(np.argmax(np.asarray(after) - before))
    return f"most at joint {joint + 1}, {_number(before[joint])} to {_number(after[joint])} rad"


def _other_series(thesis: Thesis, table: Sequence[dict[str, Any]]) -> Iterable[str]:
    """What other high-frequency series change, beside the first."""
    others = thesis.data["other_series"]
    if not others:
        return
    yield _text(
        "How much of that is the series itself, and how much this one of all that could have been drawn: the change by "
        f"three of them, drawn from seeds 1, {', '.join(map(str, thesis.settings.other_series))}. Where the changes by"
        " single series straddle zero, neither sign means more than the draw."
    )
    labels = list(others[0]["sums"])
    rows = []
    for name in dict.fromkeys(row["motion"] for row in others):
        first = next(row for row in table if row["motion"] == name)
        alone = next(row for row in table if f"HFS + {row['motion']}" == name)
        cells = []
        for label in labels:
            sums = [_sum(first, label), *(row["sums"][label] for row in others if row["motion"] == name)]
            cells.append(", ".join(_change(after, _sum(alone, label)) for after in sums))
        rows.append([name, *cells])
    yield _table(["", *labels], rows)


def _sum(row: dict[str, Any], label: str) -> float:
    return float(np.sum(row["errors"][label]))


def _case_2(thesis: Thesis) -> Iterable[str]:
    found = thesis.data["case_2"]
    yield "## Case 2: a wrong internal model that stays (section 5-4)\n"
    yield _text(
        "The two-link arm, its internal model wrong by [1, -1, 1, 1] in the base parameters; it is identified "
        "from the torque in the log and the difference fed forward. The rotor of joint 1, which motion cannot "
        "tell from link 1, is taken from table 5-2."
    )
    rows = [
        [label, *(_number(value) for value in values)]
        for label, values in (("true error", found["true_error"]), *found["recovered_errors"].items())
    ]
    yield _table(["", *found["base_parameters"]], rows)
    yield f"Largest deviation of the recovered error: {100 * found['largest_deviation']:.2f} %.\n"
    puma = thesis.data["case_2_puma"]
    yield _text(
        f"The PUMA 560, which the thesis leaves out, with links that the internal model takes {puma['factor']:g} times "
        "as heavy as they are: the error of the base parameters is recovered within "
        f"{100 * puma['deviation']:.2g} % of its norm. What the internal model lacks, as feed-forward beside it:"
    )
    rows = [
        [name, run["motion"], run["model"], _numbers(run["rmse"])]
        for name, case in (("two_link", found), ("puma560", puma))
        for run in case["tracking"]
    ]
    yield _table(["robot", "motion", "compensation from", "error at test gains [rad]"], rows)


def _beyond(thesis: Thesis) -> Iterable[str]:
    yield "## Where the thesis stops (section 6-2)\n"
    yield _text(
        "Laws that ask the model where the arm is, first test motion. Computed torque at the measured position and "
        "velocity: 100 1/s² and 20 1/s. Joint impedance at the measured position and the wanted velocity: the test "
        "gains. At the measured velocity a model would know of no friction while a joint stands, and under 10 N·m/rad "
        "joints of the PUMA 560 stuck until the error was large, whatever the model."
    )
    rows = [[row["robot"], row["law"], row["model"], _numbers(row["rmse"])] for row in thesis.data["control_laws"]]
    yield _table(["robot", "law", "model", "error of joint 1, 2, ... [rad]"], rows)
    yield _text(
        "Computed torque multiplies the feedback by the inertia that the model has, here in percent of the machine's, "
        "mean along the motion:"
    )
    rows = [[row["robot"], row["model"], _numbers(100.0 * np.asarray(row["share"]))] for row in thesis.data["inertias"]]
    yield _table(["robot", "model", "inertia about joint 1, 2, ... [%]"], rows)
    yield _text(
        "The parameters of the thesis have no rotors, which are nearly all of the inertia of joints 4 to 6 of the PUMA "
        "560. At joints 5 and 6 the feedback of *identified* is weak, as that of *internal* is, and what it knows of "
        "friction makes it worse: at the measured velocity it cancels the damping, which *identified, links alone* "
        "leaves. That *identified* follows better than *internal* can therefore not be had of these parameters under "
        "this law; with rotors, learned by a process or among the parameters, it does."
    )
    payload = thesis.data["payload"]
    yield _text(
        f"A payload of {payload['mass']:g} kg picked up after {payload['time']:g} s, first test motion, PUMA 560, "
        "control at 1 kHz; root mean square of the norm of the position error [rad]. *Recovered*: seconds from the "
        "pick-up until the error stays below twice the largest that the identified model had before. See "
        "[Online](online.md)."
    )
    rows = [
        [
            " and ".join(f"{gain:g}" for gain in row["gains"]),
            row["model"],
            _number(row["before"]),
            _number(row["first_second"]),
            _number(row["after"]),
            "never" if row["recovered"] is None else f"{row['recovered']:.2f}",
            "" if row["mass"] is None else _number(row["mass"]),
        ]
        for row in payload["rows"]
    ]
    columns = ["gains [N·m/rad, N·m·s/rad]", "", "before", "first second after", "then", "recovered [s]"]
    yield _table([*columns, "mass at the end [kg]"], rows)


def _change(new: float, old: float) -> str:
    percent = 100.0 * (new / old - 1.0)
    return f"{percent:+.{0 if abs(percent) >= 10.0 else 1}f} %"


def _text(text: str) -> str:
    return textwrap.fill(text, 120) + "\n"


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return f"{value:.4g}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)
