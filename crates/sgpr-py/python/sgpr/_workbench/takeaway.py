"""What is taken away: the model, its report, and the commands and the script that make the same model again."""

import shlex
import tempfile
from pathlib import Path
from typing import Any

from .. import Model
from .._pages import model_page
from ..cli.errors import BadData
from ..cli.reading import REPAIRS, ReadingOptions
from ..cli.robots import READY_MADE
from .bench import Bench
from .steps import ROBOT_FILE, Step


def chain_of(bench: Bench) -> list[Step]:
    """The steps that lead to the current model."""
    chain = bench.ladder.chain(bench.ladder.current)
    if chain[-1].id == ROBOT_FILE or chain[-1].model is None:
        raise BadData("fit first: there is no model to take away")
    return chain


def reading_of(bench: Bench) -> dict[str, Any] | None:
    """How logs like the training logs are read, as the model file notes it."""
    first = next(log for log in bench.logs.values() if log.role == "train")
    return ReadingOptions().lasting([str(bench.folder.path(first.name))])


def model_file(bench: Bench) -> bytes:
    """The current model, byte by byte what the commands and the script write."""
    model = chain_of(bench)[-1].model
    assert isinstance(model, Model), "asked before"
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "model.sgpr"
        model.with_reading(reading_of(bench)).save(path)
        return path.read_bytes()


def report(bench: Bench) -> str:
    """The page of `sgpr compare` for the current model, on the test logs if there are any."""
    model = chain_of(bench)[-1].model
    assert isinstance(model, Model), "asked before"
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "report.html"
        model_page(model, path, bench.used("test") or bench.used("train"))
        return path.read_text(encoding="utf-8")


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
        else:
            lines.append(f"model = sgpr.diagnose(model, train, add={step.add!r}).model")
    lines.append(f'model.with_reading({reading_of(bench)!r}).save("model.sgpr")')
    if any(log.role == "test" for log in bench.logs.values()):
        lines.append("print(sgpr.compare(model, test))")
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
