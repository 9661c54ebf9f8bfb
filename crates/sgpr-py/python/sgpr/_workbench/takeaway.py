"""What is taken away: the model, its report, and the commands and the script that make the same model again."""

import shlex
import tempfile
from pathlib import Path
from typing import Any, Literal

from .. import Model, SemiParametricModel
from .._pages import model_page
from ..cli import learn
from ..cli.errors import BadData
from ..cli.reading import REPAIRS
from ..cli.robots import READY_MADE
from .bench import Bench
from .logs import as_read, used
from .steps import ROBOT_FILE, Step, physics_of


def chain_of(bench: Bench) -> list[Step]:
    """The steps that lead to the current model."""
    chain = bench.ladder.chain(bench.ladder.current)
    if chain[-1].id == ROBOT_FILE or chain[-1].model is None:
        raise BadData("fit first: there is no model to take away")
    return chain


def model_file(bench: Bench) -> bytes:
    """The current model, byte by byte what the commands and the script write."""
    model = chain_of(bench)[-1].model
    assert model is not None, "asked before"
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "model.sgpr"
        model.save(path)
        return path.read_bytes()


def report(bench: Bench) -> str:
    """The page of `sgpr compare` or `sgpr learn` for the current model, on the test logs if there are any."""
    model = chain_of(bench)[-1].model
    if isinstance(model, SemiParametricModel):
        logs = {role: as_read(bench.logs, role) for role in ("train", "test")}
        result = learn.Result.of(model, logs["train"], logs["test"])
        data = result.to_dict() | {"settings": {}}
        return result.page(data).html()
    assert model is not None, "asked before"
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "report.html"
        model_page(model, path, used(bench.logs, "test") or used(bench.logs, "train"))
        return path.read_text(encoding="utf-8")


def source(bench: Bench, language: Literal["c", "rust"]) -> bytes:
    """The current model as a file for a controller, which needs no library."""
    model = chain_of(bench)[-1].model
    if not isinstance(model, Model):
        raise BadData("the Gaussian process is not exported: go on from the step before it")
    rate = next((log.sample_rate_hz for log in used(bench.logs, "train")), None)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "source"
        model.export(language, path, rate_hz=rate)
        return path.read_bytes()


def robot_file(bench: Bench) -> bytes:
    """The robot file with the inertias that were identified."""
    path = bench.folder.path(bench.robot_name or "")
    if path.suffix.lower() not in (".urdf", ".xml"):
        raise BadData("inertias are written back to a URDF; this robot is none")
    model = chain_of(bench)[-1].model
    assert model is not None, "asked before"
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "robot.urdf"
        physics_of(model).write_urdf(path, out)
        return out.read_bytes()


def next_experiment(bench: Bench) -> str:
    """The motion that tells the findings of the current model's diagnosis apart, as a table."""
    found = bench.missing.motions.get(bench.ladder.current)
    if found is None:
        raise BadData("there is no next experiment: look for what is missing first, or nothing imitates the findings")
    return found


def commands(bench: Bench) -> str:
    """The session as commands, to be run in the folder of the logs; how logs are read is in `sgpr.toml` there."""
    chain = chain_of(bench)
    roles = {role: [log.name for log in bench.logs.values() if log.role == role] for role in ("train", "test")}
    logs = ["--train", *roles["train"], *(["--test", *roles["test"]] if roles["test"] else [])]
    lines = [f"cd {shlex.quote(str(bench.folder.root))}"]
    start = bench.robot_name or ""
    for number, step in enumerate(chain, start=1):
        out = f"step_{number}"
        if step.after is None:
            how = ["identify", "--robot", start, *logs, "--effects", *(step.effects or ["none"])]
        elif step.rest:
            how = ["learn", "--robot", start, *logs]
        else:
            how = ["diagnose", "--robot", start, *logs, "--add", *step.add]
        lines.append(shlex.join(["sgpr", *how, "--out", out]))
        start = f"{out}/model.sgpr"
    if roles["test"]:
        lines.append(shlex.join(["sgpr", "compare", start, *roles["test"], "--out", "comparison"]))
    return "\n".join(lines) + "\n"


def script(bench: Bench) -> str:
    """The session as a Python script, to be run in the folder of the logs."""
    chain = chain_of(bench)
    lines = [
        f'"""Makes the model {_comment(chain[-1].name)} again; run it in the folder of the logs."""',
        "",
        "import sgpr",
        *([] if _from_urdf(bench) or bench.robot_name in READY_MADE else ["from sgpr.cli.robots import load_robot"]),
        "",
        f"robot = {_robot(bench)}",
        "",
        "",
        "def logs_of(path, repairs=None, **reading):",
        '    """The stretches of a log."""',
        "    log = sgpr.read(path, robot.joint_names, **reading)",
        "    return log.repair(**repairs).recordings if repairs else [log]",
        "",
        "",
    ]
    for role in ("train", "test"):
        lines.append(f"{role} = [")
        lines += [f"    *{_read(log.name, log.settings)}," for log in bench.logs.values() if log.role == role]
        lines.append("]")
    for step in chain:
        lines.append(f"# {_comment(step.name)}")
        if step.after is None:
            lines.append(f"model = sgpr.identify(robot, train, effects={step.effects!r})")
            lines.append(f"model = model.with_reading({bench.reading()!r})")
        elif step.rest:
            lines.append("model = sgpr.SemiParametricModel(model.robot, physics=model).fit(train)")
        else:
            lines.append(f"model = sgpr.diagnose(model, train, add={step.add!r}).model")
            lines.append(f"model = model.with_reading({bench.reading()!r})")
    lines.append('model.save("model.sgpr")')
    if any(log.role == "test" for log in bench.logs.values()):
        lines.append(f"print({'model.compare(test)' if chain[-1].rest else 'sgpr.compare(model, test)'})")
    return "\n".join(lines) + "\n"


def _from_urdf(bench: Bench) -> bool:
    return Path(bench.robot_name or "").suffix.lower() not in (".toml", ".json")


def _robot(bench: Bench) -> str:
    if bench.robot_name in READY_MADE:
        return f"sgpr.robots.{bench.robot_name}()"
    return f"sgpr.Robot.from_urdf({bench.robot_name!r})" if _from_urdf(bench) else f"load_robot({bench.robot_name!r})"


def _read(name: str, settings: dict[str, Any]) -> str:
    reading = {key: value for key, value in settings.items() if key not in REPAIRS and key != "joints"}
    repairs = {key: value for key, value in settings.items() if key in REPAIRS and value}
    arguments = [repr(name), *([f"repairs={repairs!r}"] if repairs else [])]
    return f"logs_of({', '.join([*arguments, *(f'{key}={value!r}' for key, value in reading.items())])})"


def _comment(text: str) -> str:
    """A name in a comment or a docstring, where nothing of it ends either."""
    return "".join(c if c.isprintable() and c not in '"\\' else "?" for c in text)
