"""Physics and what it leaves over."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
import sgpr


@pytest.fixture(scope="module")
def robot() -> sgpr.Robot:
    return sgpr.Robot.from_urdf(Path(__file__).parents[3] / "data" / "demo" / "robot.urdf")


@pytest.fixture(scope="module")
def test_log(robot: sgpr.Robot) -> list[sgpr.Recording]:
    return [sgpr.read(Path(__file__).parents[3] / "data" / "demo" / "test.csv.gz")]


@pytest.fixture(scope="module")
def model(robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> sgpr.SemiParametricModel:
    """Physics without friction, small processes."""
    model = sgpr.SemiParametricModel(
        robot, effects=["rotor_inertia"], inputs="own_velocity", points=100, max_evaluations=20
    )
    return model.fit(demo_logs)


def test_what_the_physics_lacks_is_learned(model: sgpr.SemiParametricModel, test_log: list[sgpr.Recording]) -> None:
    before, after = sgpr.compare(model.physics_, test_log), model.compare(test_log)
    assert np.all(after.rmse < 0.6 * before.rmse)
    assert model.score(test_log) == pytest.approx(np.mean(after.r2))
    assert [report["inputs"] for report in model.reports_] == ["own_velocity"] * 6
    assert all(report["points"] <= 100 and report["hyperparameters"] for report in model.reports_)
    names = {"joint", "samples", "percent_68", "percent_95", "half_width_68", "half_width_95"}
    assert names == set(model.coverage(test_log)[0])
    # The interval of 95 % is never narrower than predicted, and may hold more.
    for row, plain in zip(model.coverage(test_log, following=True), model.coverage(test_log), strict=True):
        assert abs(row["percent_68"] - 68) < 8
        assert row["half_width_95"] >= plain["half_width_95"]
        assert row["percent_95"] > 92
    assert not model.stopped_


def test_physics_may_be_there_already(
    robot: sgpr.Robot, demo_logs: list[sgpr.Recording], test_log: list[sgpr.Recording]
) -> None:
    settings = {"inputs": "own_velocity", "points": 60, "max_evaluations": 10}
    physics = sgpr.identify(robot, demo_logs, effects=["rotor_inertia"])
    given = sgpr.SemiParametricModel(robot, physics=physics, **settings).fit(demo_logs)
    found = sgpr.SemiParametricModel(robot, effects=["rotor_inertia"], **settings).fit(demo_logs)
    comparison, spread = given.compare_with_spread(test_log)
    assert np.array_equal(comparison.rmse, found.compare(test_log).rmse)
    for log, (std, interval, novelty) in zip(comparison.logs, spread, strict=True):
        assert std.shape == interval.shape == novelty.shape == log.predicted.shape
        assert np.all(std > 0) and np.all((novelty >= 0) & (novelty <= 1))
    with pytest.raises(sgpr.SgprError, match="leaves out the physics"):
        sgpr.SemiParametricModel(robot, physics=physics, mean="zero", **settings).fit(demo_logs)
    with pytest.raises(ValueError, match="give the robot of the model"):
        sgpr.SemiParametricModel(sgpr.robots.two_link(), physics=physics, **settings).fit(demo_logs)


def test_all_rows_may_be_seen_through_inducing_points(
    robot: sgpr.Robot, demo_logs: list[sgpr.Recording], test_log: list[sgpr.Recording], tmp_path: Path
) -> None:
    settings = {"effects": ["rotor_inertia"], "points": 60, "inputs": "own_joint", "max_evaluations": 15}
    errors = {}
    for sparse in (False, True, None):
        model = sgpr.SemiParametricModel(robot, sparse=sparse, **settings).fit(demo_logs)
        assert all(report["points"] <= 60 < report["rows"] for report in model.reports_)
        for report in model.reports_:
            tried = {candidate["inference"]: candidate["rmse"] for candidate in report["candidates"]}
            assert list(tried) == (["subset"] if sparse is False else ["subset", "sparse"])
            # Chosen if it gains 5 % in mean square, unless asked for.
            better = "sparse" in tried and tried["sparse"] ** 2 < 0.95 * tried["subset"] ** 2
            wanted = better if sparse is None else sparse
            assert report["inference"] == ("sparse" if wanted else "subset")
        errors[sparse] = model.compare(test_log).relative_error_percent
        model.save(tmp_path / "model.sgpr")
        assert sgpr.load(tmp_path / "model.sgpr").reports_ == model.reports_
    physics = sgpr.compare(model.physics_, test_log).relative_error_percent
    assert max(errors.values()) < 0.6 * physics
    assert errors[None] <= 1.01 * min(errors.values()), "what is best on parts left out is so on the unseen log"


def test_joints_may_share_a_kernel(
    robot: sgpr.Robot, demo_logs: list[sgpr.Recording], test_log: list[sgpr.Recording]
) -> None:
    settings = {"effects": ["rotor_inertia"], "points": 100, "max_evaluations": 20, "shared": True}
    model = sgpr.SemiParametricModel(robot, inputs="velocities", **settings).fit(demo_logs)
    kernels = [report["hyperparameters"] for report in model.reports_]
    scales = [[kernel[name] for name in kernel if name.startswith("length_scale")] for kernel in kernels]
    assert len(scales[0]) == 6 and all(other == pytest.approx(scales[0]) for other in scales)
    assert len({round(kernel["signal_variance"], 9) for kernel in kernels}) == 6, "each joint in its own units"
    before, after = sgpr.compare(model.physics_, test_log), model.compare(test_log)
    assert after.relative_error_percent < before.relative_error_percent
    q, dq, ddq = np.random.default_rng(4).uniform(-1, 1, (3, 6))
    assert np.allclose(model.predictor().torque(q, dq, ddq), model.predict(q, dq, ddq), atol=1e-9)
    with pytest.raises(sgpr.SgprError, match="own_velocity"):
        sgpr.SemiParametricModel(robot, inputs="own_velocity", **settings).fit(demo_logs)


def test_it_has_the_page_of_its_command(
    model: sgpr.SemiParametricModel, demo_logs: list[sgpr.Recording], test_log: list[sgpr.Recording], tmp_path: Path
) -> None:
    model.report(tmp_path / "rest.html", demo_logs[:1], test_log)
    page = (tmp_path / "rest.html").read_text(encoding="utf-8")
    assert all(f"{joint.rmse:.3g}" in page for joint in model.compare(test_log).joints)
    assert test_log[0].source in page
    with pytest.raises(AttributeError, match="not fitted yet"):
        sgpr.SemiParametricModel(model.physics_.robot).report(tmp_path / "none.html", demo_logs)


def test_far_from_the_data_the_physics_is_alone(model: sgpr.SemiParametricModel) -> None:
    far = np.full((2, 6), 300.0)
    tau, std, interval, novelty = model.predict(
        far, far, far, return_std=True, return_interval=True, return_novelty=True
    )
    assert np.all(interval > std)
    assert np.allclose(tau, model.physics_.predict(far, far, far))
    assert np.all(novelty > 0.95)
    near = np.zeros((2, 6))
    assert np.all(model.predict(near, near, near, return_std=True)[1] < std)
    assert model.predict(near[0], near[0], near[0]).shape == (6,)


def test_a_model_is_kept(model: sgpr.SemiParametricModel, tmp_path: Path) -> None:
    q, dq, ddq = np.random.default_rng(3).uniform(-1, 1, (3, 20, 6))
    expected = model.predict(q, dq, ddq, return_std=True)
    model.save(tmp_path / "model.sgpr")
    by_kind = sgpr.load(tmp_path / "model.sgpr")
    assert isinstance(by_kind, sgpr.SemiParametricModel)
    for again in [by_kind, pickle.loads(pickle.dumps(model)), copy.deepcopy(model)]:
        assert np.array_equal(again.predict(q, dq, ddq, return_std=True), expected)
        assert again.reports_ == model.reports_
    exact, fast = model.predictor(variance_rank=None), model.predictor(single_precision=True)
    tau, std = exact.torque_and_std(q[0], dq[0], ddq[0])
    assert np.allclose(tau, expected[0][0], atol=1e-9)
    assert np.allclose(std, expected[1][0], atol=1e-7)
    assert np.allclose(fast.torque(q[0], dq[0], ddq[0]), tau, atol=1e-3)
    with pytest.raises(sgpr.SgprError, match="made without variance"):
        fast.torque_and_std(q[0], dq[0], ddq[0])
    model.physics_.save(tmp_path / "physics.sgpr")
    assert isinstance(sgpr.load(tmp_path / "physics.sgpr"), sgpr.Model)
    with pytest.raises(sgpr.ModelFileError, match="its head says `sgpr torque model`"):
        sgpr.SemiParametricModel.load(tmp_path / "physics.sgpr")
    (tmp_path / "damaged.sgpr").write_bytes((tmp_path / "model.sgpr").read_bytes()[:-100])
    with pytest.raises(sgpr.ModelFileError, match="damaged"):
        sgpr.load(tmp_path / "damaged.sgpr")
    with pytest.raises(FileNotFoundError):
        sgpr.SemiParametricModel.load(tmp_path / "missing.sgpr")


@pytest.mark.parametrize("mean", ["joint", "zero"])
def test_the_physics_may_be_estimated_together_or_left_out(
    mean: str, robot: sgpr.Robot, demo_logs: list[sgpr.Recording], test_log: list[sgpr.Recording]
) -> None:
    model = sgpr.SemiParametricModel(
        robot, effects=["rotor_inertia"], inputs="own_joint", mean=mean, points=80, max_evaluations=10
    )
    model.fit(demo_logs)
    q, dq, ddq = np.random.default_rng(3).uniform(-1, 1, (3, 20, 6))
    _, std = model.predict(q, dq, ddq, return_std=True)
    assert np.all(std > 0)
    if mean == "joint":
        assert model.physics_.fit is not None
        assert model.physics_.fit["method"] == "gls"
    else:
        assert not model.physics_.all_parameters.any()
    assert np.isfinite(model.score(test_log))


def test_it_is_stopped_and_refused_like_the_rest(robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    def stop(stage: str, done: int, total: int) -> None:
        if stage == "processes":
            raise RuntimeError("enough")

    model = sgpr.SemiParametricModel(robot, points=50, progress=stop)
    with pytest.raises(RuntimeError, match="enough"):
        model.fit(demo_logs[:1])
    assert model.stopped_
    assert np.isfinite(model.predict(np.zeros(6), np.zeros(6), np.zeros(6))).all()
    for options, message in [
        ({"kernel": "rbf"}, "kernel = 'rbf'"),
        ({"inputs": "speed"}, "inputs = 'speed': expected 'own_velocity' or"),
        ({"mean": "none"}, "mean = 'none'"),
        ({"points": 1}, "points = 1: expected a whole number, 2 to 20000"),
    ]:
        with pytest.raises(sgpr.SgprError, match=message):
            sgpr.SemiParametricModel(robot, **options).fit(demo_logs)
    with pytest.raises(AttributeError, match="not fitted yet"):
        sgpr.SemiParametricModel(robot).predict(np.zeros(6), np.zeros(6), np.zeros(6))
