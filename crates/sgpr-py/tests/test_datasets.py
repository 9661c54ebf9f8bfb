"""Public data sets: made-up files in the formats of the origins, from a server of this machine, good and bad."""

import dataclasses
import hashlib
import http.server
import io
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run
from numpy.typing import NDArray
from sgpr import datasets

Array = NDArray[np.float64]
SAMPLES = 40
RANDOM = np.random.default_rng(5)
VALUES = RANDOM.normal(size=(SAMPLES, 40)).round(4)
RISING = np.arange(SAMPLES) * 0.01


class Origin(http.server.ThreadingHTTPServer):
    """A server whose answers are what a test puts into `files`; a name in `broken` is answered as that says."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.files: dict[str, bytes] = {}
        self.broken: dict[str, Callable[[http.server.BaseHTTPRequestHandler, bytes], None]] = {}
        self.asked: list[str] = []

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that leaves early is no error of these tests."""


class Answer(http.server.BaseHTTPRequestHandler):
    server: Origin

    def do_GET(self) -> None:
        name = self.path.rpartition("/")[2]
        self.server.asked.append(name)
        if name not in self.server.files:
            self.send_error(404, "Not Found")
            return
        content = self.server.files[name]
        if name in self.server.broken:
            self.server.broken[name](self, content)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Says nothing."""


@pytest.fixture
def origin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Origin]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    server = Origin()
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def matlab(**arrays: Array) -> bytes:
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, arrays)
    return file.getvalue()


def text(rows: Array, header: str = "") -> bytes:
    file = io.StringIO()
    np.savetxt(file, rows, "%.6f", ",", header=header, comments="")
    return file.getvalue().encode()


def one_per_line(rows: Array) -> bytes:
    return "".join(f"{value:.6f}\n" for value in rows.ravel()).encode()


def bag(tmp_path: Path) -> bytes:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    tmp_path.mkdir(exist_ok=True)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for index, row in enumerate(VALUES):
            nanoseconds = index * 10_000_000
            message = state(
                header(stamp(0, nanoseconds), ""), [f"j{k}" for k in range(6)], row[:6], row[6:12], row[12:18]
            )
            writer.write(connection, nanoseconds, store.serialize_cdr(message, state.__msgtype__))
    return next((tmp_path / "bag").glob("*.db3")).read_bytes()


URDF = b"""<robot name="r"><link name="a"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint><link name="b"/></robot>"""


def made_up(name: str, tmp_path: Path) -> dict[str, bytes]:
    """Small files in the formats of an origin."""
    v, t = VALUES, RISING
    match name:
        case "baxter":
            return {"BaxterDirectDynamics.mat": matlab(**{f"baxtertraj{k}": v[:, :35] + k for k in range(1, 11)})}
        case "kuka_lwr":
            return {"KukaDirectDynamics.mat": matlab(**{f"kukatraj{k}": v[:, :35] + k for k in range(1, 11)})}
        case "emps":
            one = {"t": t[:, None], "qm": v[:, :1], "qg": v[:, 1:2], "vir": v[:, 2:3], "gtau": np.array([[35.0]])}
            pulses = (5 * (v[:, 3:4] > 0)).astype(np.uint8)
            return {"DATA_EMPS.mat": matlab(**one), "DATA_EMPS_PULSES.mat": matlab(**one, pulses_N=pulses)}
        case "panda":
            # The origin's last sample lacks its partner.
            return {
                "exciting_traj_time.txt": one_per_line(50 * t),
                "exciting_traj_positions.txt": one_per_line(v[:, :7]),
                "exciting_traj_velocity.txt": one_per_line(v[:, 7:14]),
                "exciting_traj_torques.txt": one_per_line(v[:-1, 14:21]),
            }
        case "ur10" | "panda_30hz":
            return {f"{name.partition('_')[0]}_exciting_trajectory.db3": bag(tmp_path)}
        case "sarcos":
            return {"sarcos_inv_test.mat": matlab(sarcos_inv_test=v[:, :28])}
        case "tiago":
            names = ("position", "velocity", "effort")
            # The origin's files begin long before the robot moves.
            rows = np.column_stack([0.01 * np.arange(921 + SAMPLES), np.vstack([np.zeros((921, 8)), v[:, :8]])])
            files = {f"tiago_{name}.csv": text(rows + k, "t,torso,arms") for k, name in enumerate(names)}
            return files | {"tiago_48_schunk.urdf": URDF}
        case "tx40":
            head = ",".join(f"Joint_{k}" for k in range(1, 7))
            files = {"pos_read_data.csv": text(v[:, :6], head), "curr_data.csv": text(v[:, 6:12], head)}
            return files | {"tx40_mdh_modified.urdf": URDF}
        case "ur10e":
            rows = text(np.column_stack([300 + t, v[:, :30]]))
            broken = rows + b"301.0,0.1,0.2\n301.01," + b",".join([b"what"] * 30) + b"\n"
            sources = [source.file for source in datasets.describe(name).sources]
            return {file: broken if file.endswith(".csv") else URDF for file in sources}
        case "xmate7p":
            return {f"xMate7p_traj{k}_results.csv": text(v[:, :28] + k) for k in (1, 2, 3)} | {"XM7p.urdf": URDF}
    raise AssertionError(name)


def at(origin: Origin, name: str, files: dict[str, bytes]) -> datasets.Dataset:
    """The data set of that name as if these files lay at its origin, which is the server."""
    place = f"http://127.0.0.1:{origin.server_address[1]}"
    known = datasets.describe(name)
    origin.files = dict(files)
    assert sorted(files) == sorted(source.file for source in known.sources)
    sources = tuple(
        datasets.Source(f"{place}/{file}", hashlib.sha256(content).hexdigest(), len(content))
        for file, content in files.items()
    )
    return dataclasses.replace(known, sources=sources)


def columns(path: Path) -> tuple[list[str], Array]:
    names = path.read_text().splitlines()[0].split(",")
    return names, np.loadtxt(path, delimiter=",", skiprows=1)


@pytest.mark.parametrize("name", datasets.names())
def test_each_set_is_converted_from_the_format_of_its_origin(name: str, origin: Origin, tmp_path: Path) -> None:
    steps: list[tuple[str, int, int]] = []
    dataset = at(origin, name, made_up(name, tmp_path))
    found = datasets.fetch(dataset, tmp_path / name, progress=lambda *step: steps.append(step))
    assert steps and all(0 < done <= total for _, done, total in steps)
    files = [path for role in ("train", "test", "other") for path in found.paths(role)]
    assert files and all(path.is_file() for path in files)
    known = json.loads((found.folder / "dataset.json").read_text())
    assert known["licence"] and known["citation"] and known["origins"] == [s.url for s in dataset.sources]
    for path in files:
        names, rows = columns(path)
        joints = sum((name.startswith("q") and "ref" not in name) or "_position_" in name for name in names)
        assert joints and rows.shape[1] == len(names) and np.isfinite(rows).all()
    assert not list(found.folder.glob(".*"))
    # A second call finds everything: no file is asked for again, here or in another folder.
    asked = len(origin.asked)
    assert datasets.fetch(dataset, tmp_path / name).folder == found.folder
    again = datasets.fetch(dataset, tmp_path / "again")
    assert [path.read_bytes() for path in again.paths("train")] == [path.read_bytes() for path in found.paths("train")]
    assert len(origin.asked) == asked


def test_columns_have_the_values_of_the_origin(origin: Origin, tmp_path: Path) -> None:
    def table(name: str, log: str) -> dict[str, Array]:
        found = datasets.fetch(at(origin, name, made_up(name, tmp_path / "made")), tmp_path / name)
        names, rows = columns(found.folder / log)
        return dict(zip(names, rows.T, strict=True))

    baxter = table("baxter", "traj03.csv")
    # s0, s1, e0, e1, w0, w1, w2 in the origin's order e0, e1, s0, s1, w0, w1, w2.
    for joint, column in enumerate((2, 3, 0, 1, 4, 5, 6)):
        assert np.allclose(baxter[f"q{joint + 1}_rad"], VALUES[:, column] + 3)
        assert np.allclose(baxter[f"tau{joint + 1}_Nm"], VALUES[:, 14 + column] + 3)
    emps = table("emps", "test_pulses.csv")
    assert np.allclose(emps["force_N"], 35.0 * VALUES[:, 2]) and set(emps["pulse_raw"]) == {0.0, 5.0}
    panda = table("panda", "train_0_14s.csv")
    assert panda["t_s"].max() < 14.0 and np.allclose(panda["tau7_Nm"], VALUES[: len(panda["t_s"]), 20])
    ur10e = table("ur10e", "pair14_unloaded.csv")
    assert np.allclose(ur10e["t_s"], RISING) and np.allclose(ur10e["i6_A"], VALUES[:, 17])
    tx40, cut = table("tx40", "train.csv"), 2 * SAMPLES // 3
    assert np.allclose(tx40["tau5_Nm"], 45 * VALUES[:cut, 10] + 32 * VALUES[:cut, 11])
    assert np.allclose(32 * (tx40["q6_rad"] + tx40["q5_rad"]), VALUES[:cut, 5])
    assert np.allclose(tx40["q4_rad"], VALUES[:cut, 3] / -48.0)
    tiago = table("tiago", "test.csv")
    assert np.allclose(tiago["arm_1_joint_position_rad"], VALUES[cut:, 1])
    assert np.allclose(tiago["arm_3_joint_torque_Nm"], -8.7 * (VALUES[cut:, 3] + 2))
    ur10 = table("ur10", "train.csv")
    assert len(ur10["t_s"]) == cut and np.allclose(ur10["tau2_Nm"], VALUES[:cut, 13])


def test_logs_are_read_as_their_settings_say(origin: Origin, tmp_path: Path) -> None:
    found = datasets.fetch(at(origin, "emps", made_up("emps", tmp_path)), tmp_path / "emps")
    (log,) = found.recordings("train")
    assert found.load_robot().dof == 1 and log.dof == 1
    assert np.allclose(log.tau[:, 0], 35.0 * VALUES[:, 2])
    sarcos = datasets.fetch(at(origin, "sarcos", made_up("sarcos", tmp_path)), tmp_path / "sarcos")
    with pytest.raises(datasets.DatasetError, match="kinematics"):
        sarcos.load_robot()


@pytest.mark.parametrize("name", ["baxter", "kuka_lwr", "panda", "panda_30hz", "ur10", "emps"])
def test_our_robot_files_are_robots(name: str) -> None:
    from sgpr.cli.robots import load_robot
    from sgpr.datasets._dataset import ROBOTS

    dataset = datasets.describe(name)
    assert load_robot(str(ROBOTS / str(dataset.robot_file))).dof == {"emps": 1, "ur10": 6}.get(name, 7)


def cut_short(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content)))
    handler.end_headers()
    handler.wfile.write(content[: len(content) // 2])


def shorter(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    handler.send_response(200)
    handler.end_headers()
    handler.wfile.write(content[:-1])


def altered(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    shorter(handler, content[:-1] + b"!" + b"?")


def endless(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    handler.send_response(200)
    handler.end_headers()
    # 200 MB at most: whoever reads on to the end fails by time.
    for _ in range(200):
        handler.wfile.write(bytes(1 << 20))


def inflated(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    """A kilobyte that unpacks to a thousand."""
    import gzip

    packed = gzip.compress(bytes(200 << 20))
    handler.send_response(200)
    handler.send_header("Content-Encoding", "gzip")
    handler.send_header("Content-Length", str(len(packed)))
    handler.end_headers()
    handler.wfile.write(packed)


def refused(handler: http.server.BaseHTTPRequestHandler, content: bytes) -> None:
    handler.send_error(403, "Forbidden")


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (cut_short, "the connection broke off|damaged"),
        (shorter, "not the file that was recorded"),
        (altered, "not the file that was recorded"),
        (endless, "sends more than the .* bytes"),
        (inflated, "sends more than the .* bytes"),
        (refused, "403 Forbidden"),
    ],
)
def test_a_bad_download_leaves_nothing(
    fault: Callable[[http.server.BaseHTTPRequestHandler, bytes], None], message: str, origin: Origin, tmp_path: Path
) -> None:
    dataset = at(origin, "emps", made_up("emps", tmp_path))
    origin.broken = {"DATA_EMPS_PULSES.mat": fault}
    with pytest.raises(datasets.DatasetError, match=message):
        datasets.fetch(dataset, tmp_path / "emps")
    assert not (tmp_path / "emps").exists()
    kept = [path.name for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert kept == ["DATA_EMPS.mat"]
    # The origin is mended: the next call has what it needs, the good file of before included.
    origin.broken = {}
    assert datasets.fetch(dataset, tmp_path / "emps").paths("test")[0].exists()
    assert origin.asked.count("DATA_EMPS.mat") == 1


def test_without_a_server_the_message_says_so(origin: Origin, tmp_path: Path) -> None:
    dataset = at(origin, "emps", made_up("emps", tmp_path))
    gone = dataclasses.replace(
        dataset, sources=tuple(dataclasses.replace(s, url=f"http://127.0.0.1:1/{s.file}") for s in dataset.sources)
    )
    with pytest.raises(datasets.DatasetError, match="cannot be reached; is there a network") as refused:
        datasets.fetch(gone, tmp_path / "emps")
    # What the message offers: files that came another way.
    place = Path(str(refused.value).rpartition(" as ")[2])
    place.parent.mkdir(parents=True, exist_ok=True)
    for source in gone.sources:
        (place.parent / source.file).write_bytes(origin.files[source.file])
    assert datasets.fetch(gone, tmp_path / "by_hand").paths("test")[0].exists()
    for source in gone.sources:
        (place.parent / source.file).unlink()
    origin.files = {}
    with pytest.raises(datasets.DatasetError, match="404"):
        datasets.fetch(dataset, tmp_path / "emps")
    assert not (tmp_path / "emps").exists()


def test_a_cached_file_that_was_damaged_is_fetched_again(origin: Origin, tmp_path: Path) -> None:
    dataset = at(origin, "sarcos", made_up("sarcos", tmp_path))
    datasets.fetch(dataset, tmp_path / "one")
    (cached,) = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    cached.write_bytes(b"damaged")
    assert datasets.fetch(dataset, tmp_path / "two").paths("other")[0].exists()
    assert len(origin.asked) == 2


def test_ctrl_c_leaves_nothing(origin: Origin, tmp_path: Path) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        datasets.fetch(at(origin, "emps", made_up("emps", tmp_path)), tmp_path / "emps", progress=stop)
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert not (tmp_path / "emps").exists()


FULL_DISK = """
import resource, sys
from pathlib import Path
import test_datasets as t, sgpr.datasets as d
origin, folder, limit = t.Origin(), Path(sys.argv[1]), int(sys.argv[2])
import threading; threading.Thread(target=origin.serve_forever, daemon=True).start()
dataset = t.at(origin, "panda", t.made_up("panda", folder / "made"))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    d.fetch(dataset, folder / "panda")
except OSError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files as Linux does")
@pytest.mark.parametrize(("limit", "place"), [(500, "cache"), (3500, "panda")])
def test_a_disk_without_room_leaves_nothing(limit: int, place: str, tmp_path: Path) -> None:
    # 500 bytes stop the download; 3500 the conversion: the files of the origin are smaller than the log they make.
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": _python_path()}
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True, timeout=60)
    assert done.stdout.startswith("OSError") and "File too large" in done.stdout, done.stdout
    assert place in done.stdout
    left = list((tmp_path / "panda").rglob("*"))
    assert not left
    kept = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    # The shortest file has less than 500 bytes.
    assert len(kept) == (4 if place == "panda" else 1)


def _python_path() -> str:
    return os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])


def test_a_folder_with_other_files_is_left_alone(origin: Origin, tmp_path: Path) -> None:
    dataset = at(origin, "emps", made_up("emps", tmp_path))
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "sgpr.toml").write_text("rate = 100\n")
    with pytest.raises(datasets.DatasetError, match="holds other files"):
        datasets.fetch(dataset, mine)
    assert [path.name for path in mine.iterdir()] == ["sgpr.toml"] and not origin.asked
    # What a process that was killed has left is no file of the user's.
    (tmp_path / "emps" / ".fetching-1").mkdir(parents=True)
    datasets.fetch(dataset, tmp_path / "emps")
    other = at(origin, "sarcos", made_up("sarcos", tmp_path))
    with pytest.raises(datasets.DatasetError, match="holds the data set emps"):
        datasets.fetch(other, tmp_path / "emps")


def test_names_and_origins_are_sound() -> None:
    with pytest.raises(datasets.DatasetError, match="did you mean emps"):
        datasets.describe("empss")
    for name in datasets.names():
        dataset = datasets.describe(name)
        assert dataset.name == name and dataset.licence and dataset.citation and dataset.physics
        for source in dataset.sources:
            # A commit, not a branch: what lies there cannot change.
            assert source.url.startswith("https://raw.githubusercontent.com/")
            assert len(source.url.split("/")[5]) == 40 and len(source.sha256) == 64 and source.size > 0
        assert {log.role for log in dataset.logs} <= {"train", "test", "other"}
        # No name leads out of the folder.
        assert all(Path(file).name == file for file in [log.file for log in dataset.logs])


def test_every_set_says_what_to_do_with_it_and_what_comes_out() -> None:
    for name in datasets.names():
        dataset = datasets.describe(name)
        if dataset.robot_file:
            assert dataset.files("train") and dataset.files("test") and dataset.unseen_percent, name
        else:
            assert dataset.program and dataset.expected, name


def test_the_command_lists_and_gets(origin: Origin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = run("data", "list")
    assert listed.code == 0 and all(name in listed.out for name in datasets.names())
    assert [each["name"] for each in json.loads(run("data", "list", "--json").out)] == datasets.names()
    wrong = run("data", "get", "empss")
    assert wrong.code == 2 and "did you mean emps?" in wrong.err
    monkeypatch.chdir(tmp_path)
    dataset = at(origin, "emps", made_up("emps", tmp_path))
    monkeypatch.setattr("sgpr.datasets._fetch.describe", lambda name: dataset)
    got = run("data", "get", "emps")
    assert got.code == 0 and "cite: A. Janot" in got.out and "next: sgpr identify --robot emps/emps.urdf" in got.out
    assert (tmp_path / "emps" / "train.csv").exists()
    origin.files = {}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))
    failed = run("data", "get", "emps", "--out", "elsewhere")
    assert failed.code == 1 and "404" in failed.err and "Traceback" not in failed.err


def test_importing_sgpr_loads_nothing_that_downloads() -> None:
    program = "import sgpr, sys; print([m for m in ('pooch', 'requests', 'scipy', 'typer') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


DATA = os.environ.get("SGPR_DATA")


@pytest.mark.skipif(DATA is None, reason="SGPR_DATA does not name the folder that holds logs of real robots")
@pytest.mark.parametrize("name", ["emps", "xmate7p", "kuka_lwr"])
def test_the_expected_figure_is_what_comes_out(name: str, tmp_path: Path) -> None:
    assert DATA is not None
    real = Path(DATA) / "real" if (Path(DATA) / "real").is_dir() else Path(DATA)
    if not (real / name).exists():
        pytest.skip(f"no {name} in {real}")
    dataset = datasets.describe(name)
    (tmp_path / name).mkdir()
    for path in (real / name).iterdir():
        (tmp_path / name / path.name).symlink_to(path)
    if dataset.settings:
        (tmp_path / name / "sgpr.toml").write_text(dataset.settings)
    found = datasets.Fetched(dataset, tmp_path / name)
    model = sgpr.identify(found.load_robot(), found.recordings("train"), effects=list(dataset.effects))
    unseen = sgpr.compare(model, found.recordings("test"))
    assert unseen.relative_error_percent == pytest.approx(dataset.unseen_percent, abs=0.05)


@pytest.mark.skipif(DATA is None, reason="SGPR_DATA does not name the folder that holds logs of real robots")
def test_the_program_of_sarcos_prints_what_is_expected(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert DATA is not None
    real = Path(DATA) / "real" if (Path(DATA) / "real").is_dir() else Path(DATA)
    if not (real / "sarcos").exists():
        pytest.skip(f"no sarcos in {real}")
    dataset = datasets.describe("sarcos")
    monkeypatch.setattr(datasets, "fetch", lambda name, out: datasets.Fetched(dataset, real / "sarcos"))
    exec(dataset.program, {})
    assert float(capsys.readouterr().out) == pytest.approx(float(dataset.expected.split()[0]), abs=0.0005)
