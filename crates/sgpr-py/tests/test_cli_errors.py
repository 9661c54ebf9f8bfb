"""Wrong use is 2, bad data is 1, and each has one clear message and no traceback."""

import errno
import importlib.metadata
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import sgpr
import typer
from cli_support import DEMO_ROBOT, DEMO_TEST, DEMO_TRAIN, RECORDINGS, run, write_log
from sgpr.cli.errors import guarded
from sgpr.cli.output_folder import OutputFolder


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_log(tmp_path_factory.mktemp("log") / "log.csv", 1)


WRONG_USE = {
    "no such command": (["frobnicate"], "frobnicate"),
    "no such option": (["info", "two_link", "--frobnicate"], "--frobnicate"),
    "missing option": (["identify", "--robot", "two_link", "--train", "LOG"], "--out"),
    "missing files": (["compare", "two_link"], "FILE"),
    "unknown effect": (["info", "two_link", "--effects", "viscous_frictoin"], "did you mean viscous_friction"),
    "unknown method": (["identify", "--robot", "two_link", "--train", "LOG", "--out", "OUT", "--method", "lms"], "wls"),
    "cut-off": (["identify", "--robot", "two_link", "--train", "LOG", "--out", "OUT", "--cutoff", "-3"], "--cutoff"),
    "band": (
        ["identify", "--robot", "two_link", "--train", "LOG", "--out", "OUT", "--torque-band", "x"],
        "--torque-band",
    ),
    "same logs": (["identify", "--robot", "two_link", "--train", "LOG", "--test", "LOG", "--out", "OUT"], "--test"),
    "not a pair": (["info", "LOG", "--columns", "q_1"], "KEY=VALUE"),
    "unknown key": (["info", "LOG", "--units", "angle=deg"], "position"),
    "no folder": (["identify", "--robot", "two_link", "--train", "LOG", "--out", ""], "empty"),
    "over its log": (["predict", "two_link", "LOG", "--out", "LOG"], "would be overwritten"),
    "over its motion": (["simulate", "two_link", "LOG", "--out", "LOG"], "would be overwritten"),
    "half a pair": (
        ["excite", "--robot", "two_link", "--max-acceleration", "5", "--out", "OUT", "--position-range", "1"],
        "give two, or two for each",
    ),
    "not a rate": (["compare", "two_link", "LOG", "--resample", "fast"], "median"),
    "a log before the model": (["compare", "LOG", DEMO_ROBOT], "first the model, then the logs"),
    "a file without its option": (["identify", DEMO_ROBOT, "LOG", "--out", "OUT"], "--robot, --train, --test, --out"),
    "sessions without names": (["sessions", "--robot", "two_link", "--logs", "LOG", "LOG"], "SESSION=FILE"),
    "mcap alone": (["identify", "--robot", "two_link", "--train", "LOG", "--out", "OUT", "--mcap", "x.mcap"], "--test"),
}


@pytest.mark.parametrize("case", WRONG_USE)
def test_wrong_use(case: str, log: str, tmp_path: Path) -> None:
    arguments, expected = WRONG_USE[case]
    found = run(*({"LOG": log, "OUT": str(tmp_path / "out")}.get(word, word) for word in arguments))
    assert found.code == 2
    assert expected in " ".join(found.err.replace("│", " ").split())
    assert found.out == ""
    assert "Traceback" not in found.err


def message_of_bad_data(*arguments: object) -> str:
    found = run(*arguments)
    assert found.code == 1, found
    assert found.out == ""
    assert "Traceback" not in found.err
    assert "should not happen" not in found.err
    assert found.err.startswith("sgpr: ")
    assert found.err.count("\n") == 1, found.err
    return found.err


def test_missing_file(tmp_path: Path) -> None:
    assert "no_such.csv" in message_of_bad_data("info", tmp_path / "no_such.csv")
    assert "no_such.urdf" in message_of_bad_data("info", tmp_path / "no_such.urdf", "--json")
    assert "no file fits" in message_of_bad_data("info", tmp_path / "*.csv")


def test_unknown_joint(log: str) -> None:
    assert "ankle" in message_of_bad_data("info", RECORDINGS / "zstd.mcap", "--joints", "ankle")
    assert "joint_3" in message_of_bad_data("compare", "puma560", log)
    assert "elbow" in message_of_bad_data("info", DEMO_ROBOT, "--joints", "elbow")


def test_options_of_another_kind_of_file(log: str) -> None:
    message = message_of_bad_data("info", log, "--logged-joints", "axis1", "axis2")
    known = "`--columns`, `--rows`, `--rate`, `--trim`, `--torque-constants`, `--units`"
    assert f"the option `--logged-joints` does not apply to CSV files; those that do: {known}" in message


def test_robot_and_log_that_do_not_fit(log: str, tmp_path: Path) -> None:
    message = message_of_bad_data("identify", "--robot", DEMO_ROBOT, "--train", log, "--out", tmp_path)
    assert "joint_3" in message


def test_values_that_are_not_finite(tmp_path: Path) -> None:
    def with_hole(table: np.ndarray) -> np.ndarray:
        table[100:110, 3] = np.nan
        return table

    path = write_log(tmp_path / "nan.csv", 1, with_hole)
    assert "drop" in message_of_bad_data("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out")
    options = ("--drop-not-finite", "--resample", "100", "--no-report")
    assert run("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out", *options).code == 0


@pytest.mark.parametrize(("column", "channel", "by"), [(1, "joint_1_position", 0.2), (4, "joint_2_torque", -500.0)])
def test_a_sample_that_strays(column: int, channel: str, by: float, tmp_path: Path) -> None:
    def stray(table: np.ndarray) -> np.ndarray:
        table[700, column] += by
        return table

    path = write_log(tmp_path / "stray.csv", 1, stray)
    options = ("--robot", "two_link", "--train", path, "--out", tmp_path / "out")
    for command in ("identify", "diagnose", "learn"):
        message = message_of_bad_data(command, *options)
        assert f"`{channel}` strays in 1 sample" in message and "(--replace-strays)" in message
    clean = ("--robot", "two_link", "--train", write_log(tmp_path / "clean.csv", 1), "--out", tmp_path / "clean")
    mended, untouched = (
        json.loads(run("identify", *each, "--no-report", "--json").out)["parameters"]
        for each in ((*options, "--replace-strays"), clean)
    )
    for own, other in zip(mended, untouched, strict=True):
        assert own["value"] == pytest.approx(other["value"], abs=other["standard_deviation"])


def test_log_without_torque(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q_1,q_2\n" + "".join(f"{k / 100},{np.sin(k / 50)},{np.cos(k / 70)}\n" for k in range(2000)))
    assert "torque" in message_of_bad_data("compare", "two_link", path)


def test_torque_that_was_not_measured(tmp_path: Path) -> None:
    def silent(table: np.ndarray) -> np.ndarray:
        table[:, 4] = 0.0
        return table

    path = write_log(tmp_path / "log.csv", 1, silent)
    options = ("--robot", "two_link", "--train", path)
    for command in ("identify", "diagnose", "learn"):
        message = message_of_bad_data(command, *options, "--out", tmp_path / "out")
        assert "`joint_2` is zero in every sample" in message
        assert "`--joints`" in message
    assert run("compare", "two_link", path).code == 0

    def braked(table: np.ndarray) -> np.ndarray:
        table[:, 2] = 0.3 + 1e-5 * (np.arange(len(table)) % 3)
        return silent(table)

    path = write_log(tmp_path / "braked.csv", 1, braked)
    found = run("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out", "--no-report")
    assert found.code == 0, found.err


def test_a_rate_beside_a_time_is_told(log: str) -> None:
    assert f"{log}: the time is counted by the rate given, not taken from `t`" in run(
        "compare", "two_link", log, "--rate", "100"
    ).err.replace("\n", " ")


def test_positions_that_are_wrapped_are_told(tmp_path: Path) -> None:
    def shifted(table: np.ndarray) -> np.ndarray:
        table[:, 1] -= 0.1
        return table

    def wrapped(table: np.ndarray) -> np.ndarray:
        table[:, 1] = shifted(table)[:, 1] % (2.0 * np.pi)
        return table

    path = write_log(tmp_path / "log.csv", 1, wrapped)
    options = ("--robot", "two_link", "--train", path, "--out", tmp_path / "out", "--no-report")
    refused = run("identify", *options)
    assert refused.code == 1 and f"{path}: `joint_1_position` jumps by a full turn" in refused.err
    assert "(--unwrap)" in refused.err
    mended = json.loads(run("identify", *options, "--unwrap", "--json").out)
    plain = write_log(tmp_path / "plain.csv", 1, shifted)
    whole = json.loads(run("identify", *options[:3], plain, *options[4:], "--json").out)
    assert mended["comparison"]["after"]["relative_error_percent"] == pytest.approx(
        whole["comparison"]["after"]["relative_error_percent"], rel=1e-3
    )


def test_a_panic_is_one_message(capsys: pytest.CaptureFixture[str]) -> None:
    class PanicException(BaseException):
        """As the compiled half raises it."""

    def command() -> None:
        raise PanicException("a matrix")

    with pytest.raises(typer.Exit) as stop:
        guarded(command)()
    assert stop.value.exit_code == 1
    assert capsys.readouterr().err == "sgpr: this should not happen, please report it: PanicException: a matrix\n"


def test_truncated_mcap() -> None:
    message = message_of_bad_data("info", RECORDINGS / "truncated_zstd.mcap")
    assert "recover" in message
    assert run("info", RECORDINGS / "truncated_zstd.mcap", "--recover").code == 0


def test_folder_that_cannot_be_written(log: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    message = message_of_bad_data("identify", "--robot", "two_link", "--train", log, "--out", tmp_path / "file" / "out")
    assert "file" in message
    message = message_of_bad_data("identify", "--robot", "two_link", "--train", log, "--out", tmp_path / "file")
    assert message.endswith("file: this is no folder, and results need one\n")


@pytest.mark.parametrize(("of_file", "named"), [(True, "results/table.csv"), (False, "results")])
def test_a_full_disk_is_named(of_file: bool, named: str, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space") as failure, OutputFolder(str(tmp_path / "results")) as folder:
        written = folder.file("table.csv")
        written.write_text("a")
        raise OSError(errno.ENOSPC, "No space left on device", *([str(written)] if of_file else []))
    assert failure.value.filename == str(tmp_path / named)
    assert not list((tmp_path / "results").iterdir())


def test_file_that_is_no_model(log: str, tmp_path: Path) -> None:
    path = tmp_path / "model.sgpr"
    path.write_text("not a model")
    assert "model" in message_of_bad_data("info", path)
    assert "model.sgpr" in message_of_bad_data("compare", path, log)
    without_model = run("compare", log, log)
    assert without_model.code == 2 and "MODEL" in without_model.err


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("bad.toml", "rows = ["),
        ("bad.toml", "rows = 3"),
        ("bad.json", '{"convention": "standard", "rows": [{"a": "x"}]}'),
        ("bad.json", '{"convention": "other", "rows": []}'),
        ("bad.json", '{"convention": "standard", "rows": [{"a": 1}], "colour": 1}'),
        ("bad.urdf", "<robot"),
        ("bad.csv", "a,b\n1,2\n"),
        ("empty.csv", ""),
    ],
)
def test_damaged_files(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert name in message_of_bad_data("info", path)


def test_version_and_help() -> None:
    assert run("--version").out == f"sgpr {sgpr.__version__}\n"
    assert run("--help").code == 0
    assert "identify" in run("--help").out


def test_program_started_from_the_shell() -> None:
    found = subprocess.run([sys.executable, "-m", "sgpr.cli", "info", "missing.csv"], capture_output=True, text=True)
    assert (found.returncode, found.stdout) == (1, "")
    assert found.stderr.count("\n") == 1


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_interrupt_while_the_library_is_loading(tmp_path: Path) -> None:
    # A library that never finishes loading takes the place of the real one.
    slow = tmp_path / "sgpr" / "__init__.py"
    slow.parent.mkdir()
    slow.write_text("import time\nprint('loading', flush=True)\ntime.sleep(60)\n")
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="sgpr")
    program = subprocess.Popen(
        [sys.executable, "-c", f"from {entry.module} import {entry.attr} as main; main()"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout is not None
    assert program.stdout.readline() == "loading\n"
    program.send_signal(signal.SIGINT)
    _, err = program.communicate(timeout=60)
    assert program.returncode == 130
    assert err == "sgpr: stopped; nothing was written\n"


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_interrupt(tmp_path: Path) -> None:
    arguments = [
        "identify",
        "--robot",
        DEMO_ROBOT,
        "--train",
        *DEMO_TRAIN,
        "--test",
        DEMO_TEST,
        "--out",
        str(tmp_path / "o"),
    ]
    program = subprocess.Popen(
        [sys.executable, "-m", "sgpr.cli", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while not (tmp_path / "o").exists() and program.poll() is None:
        time.sleep(0.01)
    program.send_signal(signal.SIGINT)
    _, err = program.communicate(timeout=60)
    assert program.returncode == 130
    assert "stopped" in err
    assert "Traceback" not in err
    assert not list((tmp_path / "o").iterdir())


def test_a_log_in_the_place_of_a_robot_and_a_robot_in_that_of_a_log(log: str, tmp_path: Path) -> None:
    found = run("identify", "--robot", log, "--train", DEMO_ROBOT, "--out", tmp_path / "out")
    assert found.code == 1 and "this is a log; a robot is a URDF" in found.err
    found = run("identify", "--robot", DEMO_ROBOT, "--train", DEMO_ROBOT, "--out", tmp_path / "out")
    assert found.code == 1 and "a robot or a model, not a log" in found.err


def test_a_folder_that_cannot_be_made_is_told_before_the_work(log: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for out in (tmp_path / "file" / "deeper", Path("/proc/no_such_place")):
        found = run("identify", "--robot", "two_link", "--train", log, "--out", out)
        assert found.code == 1 and "cannot be made" in found.err and "name another one" in found.err


def test_the_folder_of_a_report_is_made(log: str, tmp_path: Path) -> None:
    report = tmp_path / "new" / "report.html"
    found = run("simulate", "two_link", log, "--out", tmp_path / "run.csv", "--report", report)
    assert found.code == 0 and report.is_file(), found.err


def test_a_log_of_more_joints_than_the_robot_has_is_no_silent_fit(tmp_path: Path) -> None:
    small = DEMO_ROBOT.replace("demo", "hidden")
    found = run("identify", "--robot", small, "--train", DEMO_TRAIN[0], "--out", tmp_path / "out", "--no-report")
    assert found.code == 0
    assert "4 more joints (q_3, q_4, q_5, q_6) are not used, as the robot has only joint_1, joint_2" in found.err
    chosen = ("--joints", "joint_1", "joint_2")
    found = run("identify", "--robot", DEMO_ROBOT, *chosen, "--train", DEMO_TRAIN[0], "--out", tmp_path / "out")
    assert found.code == 0 and "more joints" not in found.err


def test_too_few_torque_constants_are_told_by_the_name_of_the_option(log: str, tmp_path: Path) -> None:
    few = ("--torque-constants", 1.0)
    found = run("identify", "--robot", "two_link", "--train", log, *few, "--out", tmp_path / "out")
    assert found.code == 1 and "--torque-constants: got 1 value for 2 joints" in found.err, found.err


def test_columns_of_the_model_that_the_log_lacks_are_told_as_such(tmp_path: Path) -> None:
    def renamed(path: Path, seed: int) -> str:
        log = Path(write_log(path, seed))
        log.write_text(log.read_text().replace("q_", "Ax").replace("tau_", "drive"))
        return str(log)

    columns = ("--columns", "position=Ax{}", "torque=drive{}")
    train = renamed(tmp_path / "train.csv", 1)
    out = tmp_path / "out"
    found = run("identify", "--robot", "two_link", "--train", train, *columns, "--out", out, "--no-report")
    assert found.code == 0, found.err
    found = run("compare", out / "model.sgpr", write_log(tmp_path / "test.csv", 2))
    said = "the name is one of the logs of the model: give those of this log, `--columns`"
    assert found.code == 1 and "there is no column `Ax1`" in found.err and said in found.err, found.err


def test_a_web_page_in_the_place_of_a_log_is_told(tmp_path: Path) -> None:
    page = tmp_path / "log.csv"
    page.write_text("<!DOCTYPE html><html><body>Sign in</body></html>")
    for command in (("info", page), ("identify", "--robot", "two_link", "--train", page, "--out", tmp_path / "out")):
        found = run(*command)
        assert found.code == 1 and "this is a web page, not CSV: download the file itself" in found.err, found.err


def test_a_motion_of_more_joints_than_the_arm_has_is_told(tmp_path: Path) -> None:
    found = run("simulate", "two_link", DEMO_TEST, "--out", tmp_path / "run.csv")
    assert found.code == 0 and "4 more joints (q_3, q_4, q_5, q_6) are not used" in found.err, found.err
    chosen = ("--joints", "joint_1", "joint_2")
    found = run("simulate", DEMO_ROBOT.replace("demo", "hidden"), DEMO_TEST, *chosen, "--out", tmp_path / "run.csv")
    assert found.code == 0 and "more joints" not in found.err, found.err


def test_a_model_in_the_place_of_a_robot_is_told(tmp_path: Path) -> None:
    model = tmp_path / "model.sgpr"
    sgpr.Model.nominal(sgpr.robots.two_link()).save(model)
    found = run("excite", "--robot", model, "--max-acceleration", 3, "--out", tmp_path / "out")
    assert found.code == 1 and "this is a model; a robot is a URDF" in found.err, found.err


@pytest.mark.parametrize(
    ("option", "values", "message"),
    [
        ("--kp", ["-1"], "kp has -1: gains of a controller are zero or more"),
        ("--kd", ["5", "-1"], "kd has -1: gains of a controller are zero or more"),
        ("--seed", ["-1"], "-1 is no seed"),
        ("--seed", ["9" * 21], "is no seed: a whole number from 0"),
        ("--rows", ["-1", "5"], "rows = (-1, 5): expected 1 <= first <= last"),
        ("--rows", ["9" * 21, "1"], "expected 1 <= first <= last"),
        ("--split-gaps", ["0"], "split_gaps = 0: the length of a step in seconds, greater than zero"),
        ("--resample", ["0"], "neither a rate in Hz nor `median`"),
    ],
)
def test_numbers_without_a_meaning_are_named(
    option: str, values: list[str], message: str, log: str, tmp_path: Path
) -> None:
    refused = run("simulate", "two_link", log, "--out", tmp_path / "simulated.csv", option, *values)
    assert refused.code in (1, 2)
    assert message in " ".join(refused.err.replace("│", " ").split())
    assert not (tmp_path / "simulated.csv").exists()


def test_a_gravity_beyond_that_of_robot_files_is_refused(log: str, tmp_path: Path) -> None:
    for command in ("identify", "learn"):
        arm = ("--robot", "two_link", "--gravity", 0, 0, -1e300)
        refused = run(command, *arm, "--train", log, "--out", tmp_path / "o")
        assert refused.code == 1 and "gravity has a component of -1e300: give m/s²" in refused.err
    with pytest.raises(sgpr.SgprError, match="gravity has a component"):
        sgpr.robots.two_link().with_gravity([0.0, 1e10, 0.0])


def test_every_option_with_numbers_takes_or_refuses_any_of_them(log: str, tmp_path: Path) -> None:
    import typer
    from sgpr.cli.app import app

    program = typer.main.get_command(app)
    commands = {
        "info": ["info", log],
        "simulate": ["simulate", "two_link", log, "--out", tmp_path / "simulated.csv"],
        "payload": ["payload", "--robot", "two_link", "--unloaded", log, "--loaded", write_log(tmp_path / "b.csv", 2)],
    }
    asked = 0
    for name, command in commands.items():
        for option in program.commands[name].params:
            kind = str(getattr(option, "type_descriptor", ""))
            if option.param_type_name == "option" and ("int" in kind or "float" in kind):
                for value in ("-1", "nan", "1e300", "9" * 21):
                    done = run(*command, option.opts[0], *[value] * max(option.nargs, 1))
                    assert done.code in (0, 1, 2), (option.opts, value)
                    assert "should not happen" not in done.err, (option.opts, value, done.err)
                    asked += 1
    assert asked > 60


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without named pipes")
def test_a_pipe_in_place_of_a_log_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.csv")
    found = run("info", tmp_path / "log.csv")
    assert found.code == 1 and "a pipe or a device" in found.err
