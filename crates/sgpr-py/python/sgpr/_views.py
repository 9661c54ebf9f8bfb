"""What a notebook shows of robots, logs, models and diagnoses: tables (`_repr_html_`) and Plotly figures (`plot`)."""

from collections.abc import Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._sgpr import Comparison, Diagnosis, Excitation, Finding, LogSet, Model, Recording, Robot, Simulation, compare
from .report.colours import AFTER, BEFORE, line_of
from .report.figures import axis, layout
from .report.markup import prose
from .report.numbers import MISSING, significant, with_deviation

Array = NDArray[np.float64]

MOST_POINTS = 5000
"""Points of a line on a screen; between them the smallest and the largest value are kept."""

MOTION = ("position [rad, m]", "speed [rad/s, m/s]", "acceleration [rad/s², m/s²]")
MOTION_POINTS = 1000
PEAKS = ("velocity", "acceleration", "torque")

VERDICTS = {
    "effects_found": "Effects are missing from the model.",
    "nothing_missing": "Nothing is missing at this noise.",
    "unexplained_structure": "Something is missing, and no known effect is likely to be it.",
}


def table_html(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()) -> str:
    """A table as HTML, every cell escaped."""
    heads = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    below = "".join(f"<p>{prose(text)}</p>" for text in notes)
    return (
        f"<div><p><b>{escape(caption)}</b></p><table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
        f"{below}</div>"
    )


def robot_html(robot: Robot) -> str:
    """Joints and limits."""
    limits = robot.limits
    rows = [
        [
            name,
            robot.joint_kinds[k],
            _interval(float(limits["lower"][k]), float(limits["upper"][k]), robot.position_units[k]),
            _limit(float(limits["velocity"][k]), f"{robot.position_units[k]}/s"),
            _limit(float(limits["effort"][k]), robot.torque_units[k]),
        ]
        for k, name in enumerate(robot.joint_names)
    ]
    caption = f"Robot {robot.name}, {robot.dof} joints"
    return table_html(caption, ["joint", "kind", "position", "speed up to", "torque up to"], rows, robot.warnings)


def recording_html(log: Recording) -> str:
    """Ranges, and the findings that matter."""
    rows = [
        [
            name,
            _range(log.q[:, k]),
            _range(None if log.dq is None else log.dq[:, k]),
            _range(None if log.tau is None else log.tau[:, k]),
        ]
        for k, name in enumerate(log.joint_names)
    ]
    rate = "rate unknown" if log.sample_rate_hz is None else f"{significant(log.sample_rate_hz, 4)} Hz"
    caption = f"{log.source}: {len(log)} samples, {significant(log.duration, 4)} s, {rate}"
    head = ["joint", "position [rad, m]", "speed [rad/s, m/s]", "torque [N·m, N]"]
    notes = [f"{issue.rank}: {issue.message}" for issue in log.issues if issue.rank != "know"]
    if log.layout is not None:
        notes.append(log.layout["text"])
    return table_html(caption, head, rows, notes)


def model_html(model: Model) -> str:
    """Parameters with their deviations."""
    rows = []
    for index in range(len(model.parameters)):
        p = model.parameters[index]
        value, deviation = with_deviation(p.value, p.standard_deviation)
        rows.append([p.name, value, deviation, p.unit])
    for term in model.terms:
        for name, (value, deviation, unit) in term["parameters"].items():
            rows.append([f"{term['effect']}: {name}", *with_deviation(value, deviation), unit])
    effects = ", ".join(model.effects) or "none"
    caption = f"Torque model of {model.robot.name}; effects: {effects}"
    return table_html(caption, ["parameter", "value", "std. deviation", "unit"], rows, model.history)


def finding_html(finding: Finding) -> str:
    """What it is, where, how surely, with which parameters."""
    rows = [
        [name, *with_deviation(value, deviation), unit] for name, (value, deviation, unit) in finding.parameters.items()
    ]
    at = ", ".join(finding.joints) or "the whole arm"
    caption = f"{finding.effect} at {at}, probability {finding.probability:.2f}"
    notes = [finding.evidence]
    if finding.confusable_with:
        notes.append(f"could also be {', '.join(finding.confusable_with)}; {finding.separating_experiment}")
    return table_html(caption, ["parameter", "value", "std. deviation", "unit"], rows, notes)


def diagnosis_lines(diagnosis: Diagnosis) -> list[str]:
    """The answer in five lines: verdict, findings, probabilities, what is left, what comes next."""
    found = [
        f"{one.effect} at {', '.join(one.joints) or 'the whole arm'} ({one.probability:.2f})"
        for one in diagnosis.findings
    ]
    shown = found[:4] + ([f"and {len(found) - 4} more"] if len(found) > 4 else [])
    left = diagnosis.unexplained
    data = diagnosis.to_dict()
    experiments = data.get("next_experiment") or []
    if experiments:
        after = f"next: record diagnosis.next_motion, which tells {' from '.join(experiments[0]['about'])}"
    elif found:
        after = "next: better = diagnosis.model, and sgpr.compare(better, [another log])"
    elif diagnosis.verdict == "unexplained_structure":
        after = "next: look at diagnosis.structure, and add an effect of your own (sgpr.Effect)"
    else:
        after = "next: sgpr.compare(model, [a log of another motion])"
    return [
        f"Diagnosis: {diagnosis.verdict}. {VERDICTS.get(diagnosis.verdict, '')}",
        f"findings: {'; '.join(shown) or 'none'}",
        f"probability that nothing is missing {diagnosis.probability_nothing_missing:.2f}, that something unknown is "
        f"{diagnosis.probability_unexplained:.2f}",
        f"left over: {'; '.join(left) if left else 'no structure that a smooth function explains'}",
        after,
    ]


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """The answer, and the findings as a table."""
    rows = [
        [one.effect, ", ".join(one.joints) or "whole arm", f"{one.probability:.2f}", one.evidence]
        for one in diagnosis.findings
    ]
    first, *more = diagnosis_lines(diagnosis)
    return table_html(first, ["effect", "where", "probability", "evidence"], rows, more[1:])


def excitation_html(found: Excitation) -> str:
    """Largest values of the motion, and how well it reveals the parameters."""
    motion, peaks = found.trajectory, found.peaks
    lower, upper = peaks["position"].T
    rows = [
        [
            name,
            f"{significant(float(lower[k]))} … {significant(float(upper[k]))}",
            *(significant(float(peaks[kind][k])) for kind in PEAKS),
        ]
        for k, name in enumerate(motion.joint_names)
    ]
    value = significant(found.value, 4)
    caption = f"Motion of {significant(motion.duration, 4)} s, {found.status}; {found.criterion} {value}"
    notes = [f"tightest limit: {found.tightest}, used to {100.0 * found.utilisation:.0f} %"]
    return table_html(caption, ["joint", "position", "speed", "acceleration", "torque"], rows, notes)


def simulation_html(run: Simulation) -> str:
    """Tracking errors and largest torques."""
    error = np.abs(run.q - run.q_wanted)
    rows = [
        [
            name,
            significant(float(run.tracking_rmse[k])),
            significant(float(error[:, k].max())),
            significant(float(np.abs(run.tau[:, k]).max())),
        ]
        for k, name in enumerate(run.joint_names)
    ]
    caption = f"Simulation of {len(run)} samples, {significant(float(run.t[-1]), 4)} s"
    head = ["joint", "position error, root mean square [rad, m]", "largest", "largest torque [N·m, N]"]
    return table_html(caption, head, rows)


def plot_excitation(found: Excitation) -> Any:
    """A Plotly figure of positions, speeds and accelerations of a motion over time."""
    motion = found.trajectory
    time = np.linspace(0.0, motion.duration, MOTION_POINTS)
    values = zip(MOTION, motion.at(time), strict=True)
    return _over_time([(title, time, each, motion.joint_names) for title, each in values], "excitation")


def plot_simulation(run: Simulation) -> Any:
    """A Plotly figure of position error, torque and friction of a simulation over time."""
    rows = [
        ("position error [rad, m]", run.q - run.q_wanted),
        ("torque [N·m, N]", run.tau),
        ("friction [N·m, N]", run.friction),
    ]
    return _over_time([(title, run.t, values, run.joint_names) for title, values in rows], "simulation")


def plot_robot(robot: Robot, q: Any = None) -> Any:
    """A Plotly figure of the joints in space, at positions `q` (zero by default)."""
    position = np.zeros(robot.dof) if q is None else np.asarray(q, dtype=float)
    places = [np.zeros(3)]
    for name in robot.frames:
        places.append(np.asarray(robot.forward_kinematics(position, name))[:3, 3])
    points = np.array(places)
    names = ["base", *robot.frames]
    trace = {
        "type": "scatter3d",
        "mode": "lines+markers+text",
        "x": points[:, 0],
        "y": points[:, 1],
        "z": points[:, 2],
        "text": names,
        "line": {"color": AFTER, "width": 6},
        "marker": {"size": 4, "color": BEFORE},
        "showlegend": False,
    }
    scene = {"aspectmode": "data", **{f"{name}axis": {"title": {"text": f"{name} [m]"}} for name in "xyz"}}
    return _figure([trace], layout(scene=scene, title={"text": robot.name}))


def plot_recording(log: Recording) -> Any:
    """A Plotly figure of what was logged, over time."""
    arrays = [("position [rad, m]", log.q), ("speed [rad/s, m/s]", log.dq), ("torque [N·m, N]", log.tau)]
    rows = [(title, values) for title, values in arrays if values is not None]
    return _over_time([(title, log.t, values, log.joint_names) for title, values in rows], log.source)


def plot_model(model: Model, logs: Sequence[Recording] | LogSet) -> Any:
    """A Plotly figure of measured and predicted torque of logs, joint by joint, one stretch after the other."""
    return plot_comparison([("predicted", AFTER, compare(model, list(logs)))])


def plot_comparison(models: Sequence[tuple[str, str, Any]]) -> Any:
    """Measured torque, and what each of several models predicts.

    - `models`: label, colour, comparison
    """
    first = models[0][2]
    names = [joint.joint for joint in first.joints]
    units = [joint.unit for joint in first.joints]
    traces: list[dict[str, Any]] = []
    settings: dict[str, Any] = {"hovermode": "x", "height": 120 + 190 * len(names)}
    step = 1.0 / len(names)
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        suffix = "" if k == 0 else str(k + 1)
        domain = [1.0 - (k + 1) * step + 0.25 * step, 1.0 - k * step]
        settings[f"yaxis{suffix}"] = axis(f"{name} [{unit}]", domain=domain)
        settings[f"xaxis{suffix}"] = axis(
            "time [s]" if k == len(names) - 1 else "", anchor=f"y{suffix}", **({"matches": "x"} if k else {})
        )
        lines = [("measured", "#9a9a9a", first, "measured")]
        lines += [(label, colour, found, "predicted") for label, colour, found in models]
        for label, colour, found, what in lines:
            x, y = _joined([(log.t, getattr(log, what)[:, k]) for log in found.logs])
            traces.append(
                {
                    "type": "scattergl",
                    "mode": "lines",
                    "name": label,
                    "legendgroup": label,
                    "showlegend": k == 0,
                    "x": x,
                    "y": y,
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                    "line": {"color": colour, "width": 1.2},
                }
            )
    return _figure(traces, layout(**settings))


def plot_diagnosis(diagnosis: Diagnosis) -> Any:
    """A Plotly figure of the error of each joint on blocks that no fit has seen, before and after each finding."""
    steps = diagnosis.to_dict().get("steps") or []
    traces = []
    for number, step in enumerate(steps):
        label = f"{step['effect'] or 'model'} {', '.join(step['joints'])}".strip()
        traces.append(
            {
                "type": "bar",
                "name": label if number == 0 else f"with {label}",
                "x": list(step["rmse"]),
                "y": list(step["rmse"].values()),
                "marker": {"color": line_of(number)["color"]},
            }
        )
    settings = {"barmode": "group", "yaxis": axis("error on unseen blocks [N·m, N]"), "xaxis": axis("")}
    return _figure(traces, layout(**settings))


def plot_finding(finding: Finding) -> Any:
    """A Plotly figure of the error of each joint on blocks that no fit has seen, without and with the effect."""
    traces = [
        {"type": "bar", "name": label, "x": list(errors), "y": list(errors.values()), "marker": {"color": colour}}
        for label, errors, colour in (
            ("without it", finding.rmse_before, BEFORE),
            ("with it", finding.rmse_after, AFTER),
        )
    ]
    title = {"text": f"{finding.effect} at {', '.join(finding.joints) or 'the whole arm'}"}
    settings = {"barmode": "group", "yaxis": axis("error on unseen blocks [N·m, N]"), "xaxis": axis(""), "title": title}
    return _figure(traces, layout(**settings, margin={"l": 60, "r": 16, "t": 62, "b": 48}))


def _over_time(rows: Sequence[tuple[str, Array, Array, Sequence[str]]], title: str) -> Any:
    traces: list[dict[str, Any]] = []
    settings: dict[str, Any] = {"height": 120 + 220 * len(rows), "title": {"text": title}}
    step = 1.0 / len(rows)
    for k, (label, time, values, names) in enumerate(rows):
        suffix = "" if k == 0 else str(k + 1)
        settings[f"yaxis{suffix}"] = axis(label, domain=[1.0 - (k + 1) * step + 0.2 * step, 1.0 - k * step])
        settings[f"xaxis{suffix}"] = axis(
            "time [s]" if k == len(rows) - 1 else "", anchor=f"y{suffix}", **({"matches": "x"} if k else {})
        )
        for joint, name in enumerate(names):
            x, y = _thinned(time, values[:, joint])
            traces.append(
                {
                    "type": "scattergl",
                    "mode": "lines",
                    "name": name,
                    "legendgroup": name,
                    "showlegend": k == 0,
                    "x": x,
                    "y": y,
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                    "line": {**line_of(joint), "width": 1.2},
                }
            )
    return _figure(traces, layout(**settings, margin={"l": 60, "r": 16, "t": 62, "b": 48}))


def _figure(traces: list[dict[str, Any]], settings: dict[str, Any]) -> Any:
    # Not needed by those who draw nothing.
    import plotly.graph_objects as go  # type: ignore[import-untyped]

    return go.Figure({"data": traces, "layout": settings})


def _joined(pieces: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Pieces one after the other, with a gap between them."""
    times, values = [np.zeros(0)], [np.zeros(0)]
    offset = 0.0
    for time, value in pieces:
        x, y = _thinned(time, value)
        times += [x + offset, np.array([np.nan])]
        values += [y, np.array([np.nan])]
        offset += float(time[-1]) + 1.0 if len(time) else 0.0
    return np.concatenate(times), np.concatenate(values)


def _thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """As many points as a screen shows: of each group of samples the smallest and the largest."""
    if len(values) <= MOST_POINTS:
        return time, values
    edges = np.linspace(0, len(values), MOST_POINTS // 2 + 1).astype(int)
    kept: list[int] = []
    for start, end in pairwise(edges):
        part = values[start:end]
        if np.isfinite(part).any():
            kept += sorted({int(start + np.nanargmin(part)), int(start + np.nanargmax(part))})
        else:
            kept.append(int(start))
    return time[kept], values[kept]


def _range(values: Array | None) -> str:
    if values is None or not np.isfinite(values).any():
        return MISSING
    return f"{significant(float(np.nanmin(values)))} … {significant(float(np.nanmax(values)))}"


def _interval(lower: float, upper: float, unit: str) -> str:
    if lower == float("-inf") and upper == float("inf"):
        return "no limit"
    return f"{significant(lower)} … {significant(upper)} {unit}"


def _limit(value: float, unit: str) -> str:
    return "no limit" if value == float("inf") else f"{significant(value)} {unit}"


def plot_found(found: Comparison) -> Any:
    """A Plotly figure of a comparison: measured and predicted torque, joint by joint."""
    return plot_comparison([("predicted", AFTER, found)])


def process_html(process: Any) -> str:
    """Hyperparameters, noise and evidence of a fitted Gaussian process."""
    names, values = process.theta_names_, np.exp(np.asarray(process.theta_))
    rows = [[name, significant(float(value), 4)] for name, value in zip(names, values, strict=True)]
    notes = [f"log marginal likelihood {significant(float(process.log_marginal_likelihood_value_), 5)}"]
    return table_html(f"Gaussian process of {process.n_features_in_} inputs", ["hyperparameter", "value"], rows, notes)


def plot_process(process: Any, x: Array, y: Array | None) -> Any:
    """A Plotly figure of one output: over a single input with its interval of 95 %, else measured over predicted."""
    mean, half = process.predict(x, return_interval=True)
    mean, half = (np.asarray(values, dtype=float).reshape(len(mean), -1)[:, 0] for values in (mean, half))
    measured = None if y is None else np.asarray(y, dtype=float).reshape(len(mean), -1)[:, 0]
    dots: dict[str, Any] = {"type": "scatter", "mode": "markers", "name": "measured"}
    dots["marker"] = {"color": "#9a9a9a", "size": 4}
    if np.asarray(x).shape[1] == 1:
        at = np.asarray(x, dtype=float)[:, 0]
        order = np.argsort(at)
        lines = [
            _line_over(at[order], (mean + sign * half)[order], "interval of 95 %", AFTER, fill)
            for sign, fill in ((-1.0, False), (1.0, True))
        ]
        lines.append(_line_over(at[order], mean[order], "mean", AFTER, False) | {"line": {"color": AFTER, "width": 2}})
        traces = ([] if measured is None else [dots | {"x": at, "y": measured}]) + lines
        return _figure(traces, layout(xaxis=axis("input"), yaxis=axis("output")))
    if measured is None:
        raise ValueError("y: the measured outputs are needed to plot a process of several inputs")
    ends = [float(min(mean.min(), measured.min())), float(max(mean.max(), measured.max()))]
    error = {"type": "data", "array": half, "thickness": 0.7, "width": 0, "color": "#b9dcf0"}
    traces = [
        dots | {"x": measured, "y": mean, "error_y": error, "name": "predicted, with its interval of 95 %"},
        _line_over(np.array(ends), np.array(ends), "equal", "#000000", False) | {"line": {"color": "#000000"}},
    ]
    return _figure(traces, layout(xaxis=axis("measured"), yaxis=axis("predicted")))


def _line_over(x: Array, y: Array, name: str, colour: str, fill: bool) -> dict[str, Any]:
    line = {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": {"color": colour, "width": 0}}
    return line | (
        {"fill": "tonexty", "fillcolor": "rgba(86,180,233,.3)"} if fill else {"showlegend": name != "interval of 95 %"}
    )


def semi_parametric_html(model: Any) -> str:
    """What the process of each joint looks at and what it brings on parts of the logs that were left out."""
    rows = []
    for one in model.reports_:
        best = min((candidate["rmse"] for candidate in one["candidates"]), default=None)
        rows.append(
            [one["joint"], one["inputs"] or "no process", significant(one["physics_rmse_left_out"]), significant(best)]
        )
    caption = f"Physics and Gaussian processes of {model.physics_.robot.name}"
    head = ["joint", "looks at", "error of the physics left out [N·m, N]", "with a process"]
    return table_html(caption, head, rows, model.physics_.history)


def plot_semi_parametric(model: Any, logs: Sequence[Recording] | LogSet) -> Any:
    """A Plotly figure of measured torque, that of the physics and that with the processes."""
    found = [
        ("physics", BEFORE, compare(model.physics_, list(logs))),
        ("with processes", AFTER, model.compare(list(logs))),
    ]
    return plot_comparison(found)
