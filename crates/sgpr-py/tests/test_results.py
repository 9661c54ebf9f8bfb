"""The files of results against their published schema, docs/reference/results.schema.json."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from cli_support import DEMO_ROBOT, DEMO_TEST, DEMO_TRAIN, run, write_log
from jsonschema import Draft202012Validator

SCHEMA = json.loads((Path(__file__).parents[3] / "docs" / "reference" / "results.schema.json").read_text())
FILES = ("identification", "diagnosis", "learned", "comparison", "sessions", "payload", "excitation")


def faults(name: str, data: Any) -> list[str]:
    """What the schema of a file says against its content."""
    validator = Draft202012Validator({"$defs": SCHEMA["$defs"], "$ref": f"#/$defs/{name}"})
    return [f"{'/'.join(map(str, fault.absolute_path))}: {fault.message}" for fault in validator.iter_errors(data)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of every kind, of small logs that have something to be said against."""
    out = tmp_path_factory.mktemp("results")
    logs = [write_log(out / f"{seed}.csv", seed) for seed in (1, 2, 3)]
    (out / "short.csv").write_text("\n".join(Path(logs[2]).read_text().splitlines()[:600]))
    arm = ("--robot", "two_link")
    train = (*arm, "--train", logs[0], logs[1])
    model = out / "model.sgpr"
    limits = ("--max-acceleration", 4, "--max-velocity", 2, "--max-torque", 100, "--position-range", -1, 1)
    commands: tuple[tuple[object, ...], ...] = (
        ("identify", *train, "--test", out / "short.csv"),
        ("diagnose", *train, "--test", logs[2], "--look-for", "torque_ripple", "coulomb_transition"),
        ("learn", *train, "--test", logs[2], "--points", 20, "--inputs", "own_velocity"),
        ("compare", model, logs[2], "--against", "two_link", "--limit", "fit_percent=50", "--streaming"),
        ("sessions", *arm, "--logs", f"before={logs[0]}", f"after={logs[1]}"),
        ("payload", *arm, "--unloaded", logs[0], "--loaded", logs[1]),
        ("excite", *arm, *limits, "--starts", 1, "--evaluations", 5),
    )
    for command in commands:
        found = run(*command, "--out", out, "--quiet")
        assert found.code == 0, found.err
    return out


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    assert [each["$ref"].removeprefix("#/$defs/") for each in SCHEMA["oneOf"]] == list(FILES)
    known = {f"#/$defs/{name}" for name in SCHEMA["$defs"]}
    used = set(json.dumps(SCHEMA).split('"')) & {f"#/$defs/{name}" for name in (*SCHEMA["$defs"], "nothing")}
    assert used == known, "a definition that no file uses"
    words = {word for word in json.dumps(SCHEMA).split('"') if word.isidentifier()}
    short = {word for word in words if {"std", "dev", "sigma", "deviation", "deviations"} & set(word.split("_"))}
    endings = ("standard_deviation", "standard_deviations", "relative_standard_deviation_percent")
    assert [word for word in sorted(short) if not word.endswith(endings)] == []


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_as_published(folder: Path, name: str) -> None:
    data = json.loads((folder / f"{name}.json").read_text())
    assert faults(name, data) == []
    assert data["schema"] == 2 and data["robot"]["joints"] == ["joint_1", "joint_2"]
    # A key that is not published, and one that is missing, are told.
    for change in ({**data, "new": 1}, {key: value for key, value in data.items() if key != "robot"}):
        assert len(faults(name, change)) == 1
    wrong = copy.deepcopy(data)
    wrong["robot"]["joint_names"] = wrong["robot"].pop("joints")
    assert faults(name, wrong)


def test_what_a_larger_arm_writes_is_as_published(tmp_path: Path) -> None:
    logs = ("--robot", DEMO_ROBOT, "--train", DEMO_TRAIN[0], "--test", DEMO_TEST)
    for options in (("--consistent",), ("--essential",)):
        found = run("identify", *logs, *options, "--out", tmp_path, "--no-report", "--quiet")
        assert found.code == 0, found.err
        data = json.loads((tmp_path / "identification.json").read_text())
        assert faults("identification", data) == []
        assert data["certificate" if options == ("--consistent",) else "essential"]


def test_json_of_the_other_commands_has_the_same_head(folder: Path, tmp_path: Path) -> None:
    model, log = folder / "model.sgpr", folder / "1.csv"
    for command in (
        ("predict", model, log, "--out", tmp_path / "torque.csv"),
        ("simulate", "two_link", log, "--out", tmp_path / "run.csv"),
    ):
        data = json.loads(run(*command, "--json").out)
        assert data["schema"] == 2 and faults("versions", data["versions"]) == []
