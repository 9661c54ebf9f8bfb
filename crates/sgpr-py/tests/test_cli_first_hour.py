"""What a user meets in the first hour: nothing is silent, nothing is to be guessed."""

import gzip
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import DEMO_ROBOT, DEMO_TEST, DEMO_TRAIN, Array, run, torque, write_log
from rich.console import Console
from sgpr.cli import console as cli_console
from sgpr.cli.console import Output
from sgpr.cli.errors import of_command_line


def turning(name: str, parent: str, child: str, at: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="9"/></joint>'
    )


def body(name: str) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="2"/><origin xyz="0.2 0 0"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>'
    )


ARM_WITH_A_GRIPPER = "".join(
    [
        '<robot name="arm"><link name="base"/>',
        *(body(name) for name in ("upper", "lower", "tip")),
        turning("joint_1", "base", "upper", "0 0 0"),
        turning("joint_2", "upper", "lower", "0.5 0 0"),
        turning("finger", "lower", "tip", "0.4 0 0"),
        "</robot>",
    ]
)


def identify(train: object, out: Path, *more: object) -> object:
    return run("identify", "--robot", "two_link", "--train", train, "--out", out, "--no-report", *more)


def in_degrees(table: Array) -> Array:
    table[:, 1:3] = np.rad2deg(table[:, 1:3])
    return table


def a_thousandfold(table: Array) -> Array:
    table[:, 3:] *= 1000.0
    return table


def with_lost_rows(table: Array) -> Array:
    return np.delete(table, [100, 500, 501, 900, 1300, 1700], axis=0)


def negated(table: Array) -> Array:
    table[:, 4] *= -1.0
    return table


def test_what_contradicts_the_robot_is_told_everywhere(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1, negated)
    text = "the torque of joint_2 looks negated"
    model = sgpr.identify(sgpr.robots.two_link(), [sgpr.read(path)])
    assert model.report is not None and any(text in said for said in model.report.warnings)
    assert f"look: {text}" in run("info", path, "--robot", "two_link").out
    found = identify(path, tmp_path / "out", "--test", write_log(tmp_path / "test.csv", 2))
    assert f"look: {text}" in found.err and "UserWarning" not in found.err
    # Nobody goes on with a model that is worse than the robot file.
    assert "do not use it" in found.err and "next: sgpr info two_link" in found.out


def test_the_next_command_for_currents_is_one_that_works(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(Path(write_log(path, 1)).read_text().replace("tau_", "current_"))
    looked = run("info", "two_link", path)
    assert looked.code == 1 and "--torque-constants joint_1=K joint_2=K --remember" in looked.out
    next_one = looked.out.split("next: sgpr ")[1].split("  (")[0].replace("=K", "=1.5").replace("\n", " ")
    found = run(*shlex.split(next_one.removesuffix("--remember")))
    assert found.code == 0, found.err


@pytest.mark.parametrize("change", [in_degrees, a_thousandfold, with_lost_rows])
def test_info_refuses_what_identify_refuses(tmp_path: Path, change: object) -> None:
    path = write_log(tmp_path / "log.csv", 1, change)
    looked = run("info", path, "--robot", "two_link")
    fitted = identify(path, tmp_path / "out")
    assert (looked.code, fitted.code) == (1, 1)
    assert "stop: " in looked.out
    option = {in_degrees: "--units position=", a_thousandfold: "--units torque=", with_lost_rows: "--resample"}[change]
    assert option in looked.out and option in fitted.err
    good = write_log(tmp_path / "good.csv", 1)
    assert run("info", good, "--robot", "two_link").code == identify(good, tmp_path / "out").code == 0


def test_torques_of_another_unit_are_confirmed(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1, a_thousandfold)
    found = identify(path, tmp_path / "out", "--units", "torque=mNm", "--json")
    assert found.code == 0
    errors = json.loads(found.out)["comparison"]["after"]["relative_error_percent"]
    assert errors < 1.0
    assert identify(path, tmp_path / "out", "--accept", "torque_scale").code == 0


def test_joints_in_order_are_confirmed(tmp_path: Path) -> None:
    t, q, tau = torque(1)
    robot = tmp_path / "arm.toml"
    rows = "".join(f"[[rows]]\na = {a}\nalpha = 0.0\nd = 0.0\ntheta = 0.0\nmass = 2.0\n" for a in (0.5, 0.4))
    robot.write_text(f'convention = "standard"\njoints = ["shoulder", "elbow"]\ngravity = [0, -9.81, 0]\n{rows}')
    path = tmp_path / "log.csv"
    header = "t,q_1,q_2,tau_1,tau_2"
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=header, comments="")
    options = ("identify", "--robot", robot, "--train", path, "--out", tmp_path / "out", "--no-report")
    refused = run(*options)
    assert refused.code == 1
    assert "`--accept joints_by_order`" in refused.err
    confirmed = run(*options, "--accept", "joints_by_order")
    assert confirmed.code == 0, confirmed.err
    assert "shoulder = q_1, tau_1; elbow = q_2, tau_2" in confirmed.out
    # The same rule where the log is read before the robot is known.
    log = sgpr.read(path)
    arm = sgpr.Robot.from_dh(
        [{"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0}] * 2, convention="standard", joint_names=["shoulder", "elbow"]
    )
    with pytest.raises(sgpr.SgprError, match="joints_by_order"):
        sgpr.compare(arm, [log])
    sgpr.compare(arm, [log.accept(["joints_by_order"])])
    sgpr.compare(arm, [sgpr.Recording(t, q, tau=tau)])


def test_a_finding_at_several_joints_is_one_line(tmp_path: Path) -> None:
    def with_torques_that_stop(table: Array) -> Array:
        table[1500:, 3:] = table[:, 3:].mean(axis=0).round(3)
        return table

    path = write_log(tmp_path / "log.csv", 1, with_torques_that_stop)
    lines = [line for line in run("info", path).out.splitlines() if "_torque` stays at" in line]
    assert len(lines) == 1 and lines[0].startswith("look: `joint_1_torque` stays at ")
    assert " for 500 samples (25 %) in 1 stretch" in lines[0]
    assert lines[0].endswith("(--trim) (the same of `joint_2_torque`)")
    assert [issue["channel"] for issue in json.loads(run("info", path, "--json").out)[0]["issues"]] == [
        "joint_1_torque",
        "joint_2_torque",
    ]


def test_the_next_command_for_a_log_of_fewer_joints_names_those(tmp_path: Path) -> None:
    header, *rows = gzip.decompress(Path(DEMO_TRAIN[0]).read_bytes()).decode().splitlines()
    kept = [k for k, name in enumerate(header.split(",")) if not name.endswith("_6")]
    path = tmp_path / "log.csv"
    path.write_text("".join(",".join(row.split(",")[k] for k in kept) + "\n" for row in (header, *rows)))
    looked = run("info", DEMO_ROBOT, path)
    assert looked.code == 1
    command = looked.out.split("next: sgpr ")[1].split("  (")[0].replace("\n", " ")
    assert command.endswith("--joints joint_1 joint_2 joint_3 joint_4 joint_5")
    found = run(*shlex.split(command))
    assert found.code == 0 and "taken to stand at zero: joint_6" in found.err
    assert "--joints joint_1 joint_2 joint_3 joint_4 joint_5" in found.out.split("next: sgpr identify")[1]


@pytest.mark.parametrize("change", ["backwards", "missing"])
def test_info_identify_and_python_refuse_in_the_same_words(tmp_path: Path, change: str) -> None:
    def broken(table: Array) -> Array:
        if change == "backwards":
            table[1000:, 0] -= table[1000, 0]
        else:
            table[500:520, 3] = np.nan
        return table

    path = write_log(tmp_path / "log.csv", 1, broken)
    with pytest.raises(sgpr.SgprError) as refused:
        sgpr.identify(sgpr.robots.two_link(), [sgpr.read(path)])
    told = run("info", "two_link", path).out.split("stop: ")[1].splitlines()[0]
    assert told in identify(path, tmp_path / "out").err
    assert of_command_line(str(refused.value)).endswith(told)


def test_a_copy_counts_once_and_is_told(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1)
    shutil.copy(path, tmp_path / "copy.csv")
    once = json.loads(identify(path, tmp_path / "out", "--json").out)
    twice = identify((tmp_path / "log.csv"), tmp_path / "out", "--train", tmp_path / "copy.csv", "--json")
    assert "copy.csv is a copy of" in twice.err
    assert json.loads(twice.out)["samples"] == once["samples"]
    log = sgpr.read(path)
    with pytest.warns(UserWarning, match="is a copy of"):
        sgpr.identify(sgpr.robots.two_link(), [log, log])


def test_units_that_nobody_meant_are_refused_in_python() -> None:
    t, q, tau = torque(1)
    robot = sgpr.robots.two_link()
    degrees = sgpr.Recording(t, np.degrees(q), tau=tau)
    with pytest.raises(sgpr.SgprError, match="looks like degrees"):
        sgpr.identify(robot, [degrees])
    with pytest.raises(sgpr.SgprError, match="give the unit of the time"):
        sgpr.identify(robot, [sgpr.Recording(1000.0 * t, q, tau=tau)])
    with pytest.raises(sgpr.SgprError, match="times what gravity asks"):
        sgpr.identify(robot, [sgpr.Recording(t, q, tau=1000.0 * tau)])
    sgpr.identify(robot, [degrees.accept(["position_in_degrees"])])
    with pytest.raises(sgpr.RecordingError, match="cannot be confirmed"):
        degrees.accept(["not_finite"])


def test_every_command_says_which_column_is_what(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1)
    said = (
        "joint_1 = q_1, tau_1; joint_2 = q_2, tau_2; position in rad (m) (assumed), torque in N·m (N) (assumed); time t"
    )
    model = tmp_path / "out" / "model.sgpr"
    for command in (
        ("info", path),
        ("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out", "--no-report"),
        ("compare", model, path),
        ("predict", model, path, "--out", tmp_path / "torque.csv"),
        ("diagnose", "--robot", model, "--train", path, "--out", tmp_path / "diagnosis", "--look-for", "payload"),
        ("learn", "--robot", model, "--train", path, "--out", tmp_path / "learned", "--points", "20"),
    ):
        found = run(*command)
        assert found.code == 0, found.err
        assert found.out.count(said) == 1, found.out


def test_a_model_remembers_how_its_logs_were_read(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1, in_degrees)
    other = write_log(tmp_path / "other.csv", 2, in_degrees)
    assert identify(path, tmp_path / "out", "--units", "position=deg").code == 0
    model = tmp_path / "out" / "model.sgpr"
    assert sgpr.load(model).reading == {"units": {"position": "deg"}}
    found = run("compare", model, other, "--json")
    assert json.loads(found.out)["comparison"]["relative_error_percent"] < 1.0
    assert run("info", other).code == 1
    assert run("info", other, "--like", model).code == 0
    # What is said counts for more than what is remembered.
    assert "position in rad;" in run("info", other, "--like", model, "--units", "position=rad").out.replace(",", ";")


def test_a_project_file_holds_for_all_commands(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1, in_degrees)
    looked = run("info", path, "--units", "position=deg", "--trim", "0", "10", "--remember")
    assert looked.code == 0
    assert (tmp_path / "sgpr.toml").read_text() == (
        'units = { position = "deg" }\n\n[files."log.csv"]\ntrim = [0.0, 10.0]\n'
    )
    assert run("info", path).code == 0
    data = json.loads(identify(path, tmp_path / "out", "--json").out)
    assert data["logs"][0]["columns"]["joints"][0]["position"]["unit"] == "deg"
    assert data["logs"][0]["used"][0]["samples"] == 1001
    (tmp_path / "sgpr.toml").write_text("unit = 3\n")
    assert "there is no setting `unit`; known are columns, units" in run("info", path).err
    (tmp_path / "sgpr.toml").write_text("units = {\n")
    assert run("info", path).code == 1


@pytest.mark.parametrize(
    ("line", "example"),
    [
        ('rate = "fast"', "rate = 250.0"),
        ("units = 3", 'units = { position = "deg" }'),
        ("units = { position = 3 }", 'units = { position = "deg" }'),
        ('columns = "q"', "columns = { position"),
        ('torque_constants = [1.0, "a"]', "torque_constants = {"),
        ("rows = [1]", "rows = [635, 3510]"),
        ("rows = [3.5, 9.2]", "rows = [635, 3510]"),
        ("trim = 5", "trim = [2.0, 30.0]"),
        ("resample = true", "resample = 250.0"),
        ("resample = nan", "resample = 250.0"),
        ('clock = "sun"', 'clock = "header"'),
        ('recover = "no"', "recover = true"),
        ("sort = 1", "sort = true"),
        ('accept = "torque_scale"', 'accept = ["joints_by_order"]'),
        ("joints = 5", 'joints = ["shoulder", "elbow"]'),
        ("rate = 2020-01-01", "rate = 250.0"),
        ('[files."*"]\nrate = "fast"', "rate = 250.0"),
    ],
)
def test_a_setting_of_another_kind_is_named_with_an_example(line: str, example: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1)
    (tmp_path / "sgpr.toml").write_text(line + "\n")
    for command in (("info", path), ("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out")):
        refused = run(*command)
        assert refused.code == 1
        assert f"{tmp_path / 'sgpr.toml'}: {line.splitlines()[-1]} does not fit; write it like {example}" in refused.err


def test_joints_of_the_project_are_those_of_the_robot_file(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1)
    robot = tmp_path / "arm.urdf"
    robot.write_text(ARM_WITH_A_GRIPPER)
    (tmp_path / "sgpr.toml").write_text('joints = ["joint_1", "joint_2"]\n')
    out = tmp_path / "out"
    for command in (
        ("info", path, "--robot", robot),
        ("identify", "--robot", robot, "--train", path, "--out", out),
        ("diagnose", "--robot", robot, "--train", path, "--look-for", "payload", "--out", tmp_path / "found"),
        ("compare", robot, path),
        ("predict", robot, path, "--out", tmp_path / "torque.csv"),
    ):
        done = run(*command)
        assert done.code == 0, f"{command}\n{done.err}"
    assert sgpr.load(out / "model.sgpr").robot.joint_names == ["joint_1", "joint_2"]
    # What the command says counts for more.
    refused = run("identify", "--robot", robot, "--train", path, "--joints", "finger", "--out", out)
    assert refused.code == 1 and "finger" in refused.err


def test_torque_constants_by_name(tmp_path: Path) -> None:
    t, q, tau = torque(1)
    path = tmp_path / "log.csv"
    current = tau / np.array([8.0, 2.0])
    table = np.column_stack([t, q[:, ::-1], current[:, ::-1]])
    names = "t,joint_2_position,joint_1_position,joint_2_current,joint_1_current"
    np.savetxt(path, table, delimiter=",", header=names, comments="")
    for constants in (["8", "2"], ["joint_2=2", "joint_1=8"]):
        for command in (
            ["info", path],
            ["identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out"],
        ):
            found = run(*command, "--torque-constants", *constants)
            assert found.code == 0, found.err
            assert "joint_1_current * 8" in found.out and "joint_2_current * 2" in found.out
    assert run("info", path, "--torque-constants", "8", "joint_2=2").code == 2


def numbers_of(text: str) -> list[str]:
    return re.findall(r"-?\d+\.\d+(?:e[-+]\d+)?", text)


LOGS = ("--train", *DEMO_TRAIN, "--test", DEMO_TEST)
MOTION = ("--max-acceleration", 4, "--max-velocity", 2, "--max-torque", 100, "--position-range", -1, 1)
TABLES = [
    ("info", "two_link", DEMO_ROBOT, DEMO_TEST),
    ("info", "--base-parameters", "two_link"),
    ("effects",),
    ("effects", "stribeck_friction"),
    ("data", "list"),
    ("identify", "--robot", DEMO_ROBOT, *LOGS, "--out", "identify", "--no-report"),
    ("info", "identify/model.sgpr"),
    ("compare", "identify/model.sgpr", DEMO_TEST, "--limit", "fit_percent=80"),
    ("learn", "--robot", DEMO_ROBOT, *LOGS, "--points", 40, "--inputs", "own_velocity", "--out", "learn"),
    ("info", "learn/model.sgpr"),
    ("sessions", "--robot", DEMO_ROBOT, "--logs", f"a={DEMO_TRAIN[0]}", f"b={DEMO_TRAIN[1]}", "--out", "sessions"),
    ("payload", "--robot", DEMO_ROBOT, "--unloaded", DEMO_TRAIN[0], "--loaded", DEMO_TRAIN[1]),
    ("excite", "--robot", "puma560", *MOTION, "--starts", 1, "--evaluations", 20, "--out", "excite"),
    ("fleet", "simulate", "--robot", "two_link=two_link", "--arms", 2, "--days", 3, "--out", "logs"),
    ("fleet", "run", "logs/fleet.csv", "--robot", "two_link=two_link", "--out", "records"),
    ("fleet", "report", "records", "--robot", "two_link=two_link", "--out", "fleet"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where these commands write, one after the other."""
    return tmp_path_factory.mktemp("tables")


@pytest.mark.parametrize("command", TABLES, ids=lambda command: " ".join(map(str, command[:2])))
def test_no_number_is_broken_or_cut(command: tuple[object, ...], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if command[0] == "fleet":
        pytest.importorskip("pyarrow", reason="fleets need the extra `fleet`")
    monkeypatch.chdir(folder)
    found = run(*command)
    assert found.code == 0, found.err
    for width in (40, 80, 100, 120):
        terminal = io.StringIO()
        console = Console(file=terminal, width=width, highlight=False, color_system=None)
        with monkeypatch.context() as narrower:
            narrower.setattr(cli_console, "_console", lambda stream, console=console: console)
            assert run(*command).code == 0
        narrow = terminal.getvalue()
        # Sentences wrap in the terminal, on their own; tables are the program's.
        tables = [line for line in narrow.splitlines() if re.match(r"  (?!\w[\w ]*: )| ─", line)]
        assert all(len(line) <= width for line in tables), max(tables, key=len)
        assert "…" not in narrow.replace(" … ", " ")
        # Every number of the narrow tables is one of the wide ones, none is a piece.
        assert set(numbers_of("\n".join(tables))) <= set(numbers_of(found.out + found.err))


def test_columns_go_before_tables_are_cut(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def shown(width: int) -> str:
        monkeypatch.setattr(cli_console, "_console", lambda stream: Console(file=sys.stdout, width=width))
        row = ["elbow", "0.0992", "12345.6", "9.875"]
        Output().table(["joint", "RMSE", "zero", "largest"], [row], spare=("zero", "largest"))
        return capsys.readouterr().out

    assert "zero" in shown(80) and "not shown" not in shown(80)
    assert "12345.6" not in shown(32) and "9.875" in shown(32) and "not shown at this width: zero" in shown(32)
    assert "0.0992" in shown(20) and "9.875" not in shown(20)


def test_a_model_worse_than_the_robot_file_says_so(tmp_path: Path) -> None:
    def noise(table: Array) -> Array:
        table[:, 3:] += 20.0 * np.random.default_rng(0).standard_normal(table[:, 3:].shape)
        return table[:300]

    train, test = write_log(tmp_path / "train.csv", 1, noise), write_log(tmp_path / "test.csv", 2)
    found = identify(train, tmp_path / "out", "--test", test)
    assert found.code == 0
    assert "The model is worse on the test logs than the robot file: do not use it." in found.err
    assert identify(train, tmp_path / "out", "--test", test, "--strict").code == 1
    good = write_log(tmp_path / "good.csv", 3)
    assert identify(good, tmp_path / "out", "--test", test, "--strict").code == 0


def test_the_demo_of_the_repository_warns_in_one_line_at_most(tmp_path: Path) -> None:
    logs = ("--train", *DEMO_TRAIN, "--test", DEMO_TEST)
    effects = ("--effects", "viscous_friction", "coulomb_friction", "rotor_inertia")
    found = run("identify", "--robot", DEMO_ROBOT, *logs, "--out", tmp_path / "out", *effects, "--no-report")
    assert found.code == 0
    assert len(found.err.splitlines()) <= 1
    [last] = [line for line in found.out.splitlines() if line.startswith("next: ")]
    assert last.startswith(f"next: sgpr diagnose --robot {tmp_path / 'out' / 'model.sgpr'} --train")


def test_effects_are_listed_and_explained() -> None:
    listed = run("effects")
    assert listed.code == 0
    assert all(effect["name"] in listed.out for effect in sgpr.effects())
    explained = run("effects", "coulomb_friction")
    assert "tau = Fc sgn(dq)" in explained.out and "parameter Fc: N·m" in explained.out
    assert "it is of the arm, and a feed-forward torque holds it: the drive" in " ".join(explained.out.split())
    delay = " ".join(run("effects", "torque_delay").out.split())
    assert "of the measurement, and a feed-forward torque leaves it out" in delay and "not in the arm" in delay
    [data] = json.loads(run("effects", "coulomb_friction", "--json").out)
    assert data["formula"] == "tau = Fc sgn(dq)"
    mistaken = run("effects", "viscous_frition")
    assert mistaken.code == 2
    assert "did you mean viscous_friction?" in " ".join(re.sub("[│\n]", " ", mistaken.err).split())
    # A part of the name is enough.
    assert "did you mean stribeck_friction?" in " ".join(re.sub("[│\n]", " ", run("effects", "stribek").err).split())


def test_the_demo_needs_no_file(tmp_path: Path) -> None:
    found = run("demo", "--out", tmp_path / "demo", "--json")
    assert found.code == 0, found.err
    data = json.loads(found.out)
    assert data["error_after_percent"] < 0.1 * data["error_before_percent"]
    for name in ("train_1.csv", "train_2.csv", "test.csv", "model.sgpr", "report.html"):
        assert (tmp_path / "demo" / name).stat().st_size > 1000
    assert run("demo", "--effect", "no_such", "--out", tmp_path / "demo").code == 2


def test_the_package_is_a_program() -> None:
    done = subprocess.run([sys.executable, "-m", "sgpr", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("sgpr ")


def test_the_report_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    path = write_log(tmp_path / "log.csv", 1)
    found = run("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out", "--open")
    assert found.code == 0
    assert opened == [(tmp_path / "out" / "report.html").resolve().as_uri()]


def test_info_names_the_columns_that_could_be_torques(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "\n".join(f"{10 * k};{k};{2 * k};{k},5;{k}" for k in range(20))
    log.write_text(f"Cell 4; monitor\nclock_ms;Ax1 pos [deg];Ax2 pos [deg];Ax1 drv;Ax2 drv\n{rows}\n")
    said = run("info", "two_link", log)
    assert "--columns torque=Ax{} drv" in said.out
    columns = "'position=Ax{} pos [deg]' 'torque=Ax{} drv'"
    assert f"next: sgpr info two_link {log} --columns {columns} --remember" in said.out.replace("\n", "")
    assert "nothing suspicious" not in said.out and "stands for" not in said.out
    # Without a robot only the torques are to be named.
    alone = run("info", log)
    assert alone.code == 1
    assert f"next: sgpr info {log} --columns 'torque=Ax{{}} drv' --remember" in alone.out.replace("\n", "")
    named = run("info", log, "--columns", "torque=Ax{} drv")
    assert "no torque" not in named.out and "next: sgpr identify" in named.out
    # Alone a robot shows its base parameters.
    assert "stands for" in run("info", "two_link").out
    refused = run("identify", "--robot", "two_link", "--train", log, "--columns", "torque=Ax{} drv", "--out", tmp_path)
    assert refused.code == 1 and "`Ax1`" in refused.err and "no time column" not in refused.err


def test_a_robot_beside_logs_is_their_robot(tmp_path: Path) -> None:
    t, q, tau = torque(1)
    header = "t,Ax1 act pos,Ax2 act pos,Ax1 drv,Ax2 drv"
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=header, comments="")
    looked = run("info", "two_link", path)
    assert looked.code == 1
    assert "stop: " in looked.out and "`Ax1`" in looked.out
    # The command that comes next is complete.
    next_one = re.search(r"next: sgpr (.*?)  \(", looked.out)
    assert next_one is not None
    words = shlex.split(next_one[1])
    assert words[3:] == ["--columns", "position=Ax{} act pos", "torque=Ax{} drv", "--remember"]
    confirmed = run(*words)
    assert confirmed.code == 0, confirmed.out + confirmed.err
    assert identify(path, tmp_path / "out").code == 0
    (tmp_path / "other").mkdir()
    for change in (in_degrees, a_thousandfold, with_lost_rows):
        bad = write_log(tmp_path / "other" / "log.csv", 1, change)
        assert run("info", "two_link", bad).code == 1, change


def test_a_log_without_torque_is_refused_by_info_as_by_identify(tmp_path: Path) -> None:
    t, q, tau = torque(1)
    path = tmp_path / "log.csv"
    header = "t,q_1,q_2,i1_A,i2_A"
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=header, comments="")
    looked, fitted = run("info", path), identify(path, tmp_path / "out")
    assert (looked.code, fitted.code) == (1, 1)
    assert "stop: no torque in this log" in looked.out
    assert "--torque-constants" in fitted.err and "torque_constants" not in fitted.err
    assert run("info", path, "--torque-constants", "1", "1").code == 0


def test_the_next_command_reads_as_this_one(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.csv", 1, in_degrees)
    said = run("info", "two_link", path, "--units", "position=deg", "--drop-repeated").out
    assert f"--train {path} --units position=deg --drop-repeated --out result" in said.replace("\n", " ")


def test_shares_of_a_torque_are_refused(tmp_path: Path) -> None:
    t, q, tau = torque(1)
    path = tmp_path / "log.csv"
    header = "t,q_1,q_2,torque1 [%],torque2 [%]"
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=header, comments="")
    assert "`%` is no known unit of torque" in run("info", path).err
    named = ("--columns", "torque=torque{} [%]", "--torque-constants", "2", "2")
    found = run("info", path, *named, "--json")
    assert found.code == 0, found.err
    assert json.loads(found.out)[0]["columns"]["joints"][0]["torque"]["torque_constant"] == 2.0


def test_the_next_command_repairs_what_stops_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "log.csv", 1, with_lost_rows)
    looked = run("info", "log.csv", "--robot", "two_link")
    assert looked.code == 1
    [said] = re.findall(r"^next: sgpr (.*?)  \(if that is right\)$", looked.out, re.MULTILINE)
    assert said.startswith("info log.csv --robot two_link --resample 100 --remember")
    again = run(*shlex.split(said))
    assert again.code == 0 and "next: sgpr identify --robot two_link --train log.csv" in again.out
    (tmp_path / "sgpr.toml").unlink()
    write_log(tmp_path / "degrees.csv", 1, in_degrees)
    looked = run("info", "degrees.csv", "--robot", "two_link")
    assert "--units position=deg --remember  (if that is right)" in looked.out
    # What only a person knows is no repair.
    write_log(tmp_path / "large.csv", 1, a_thousandfold)
    assert "if that is right" not in run("info", "large.csv", "--robot", "two_link").out


def test_the_answer_comes_before_a_table_of_many_parameters(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("identify", "--robot", DEMO_ROBOT, "--train", DEMO_TRAIN[0], "--test", DEMO_TEST, "--out", out)
    assert "base parameters, " in done.out and "joint_1.Izz" not in done.out
    count = int(re.search(r"^(\d+) base parameters", done.out, re.MULTILINE).group(1))
    listed = run("info", out / "model.sgpr")
    assert sum(line.strip().startswith("joint_") for line in listed.out.splitlines()) >= count
    # Few are shown.
    few = identify(write_log(tmp_path / "log.csv", 1), tmp_path / "few", "--effects", "viscous_friction")
    assert "std. deviation" in few.out and "base parameters, " not in few.out
