"""The torque model: kept, read, added, used."""

import copy
import dataclasses
import pickle
import threading
from pathlib import Path

import numpy as np
import pytest
import sgpr
from conftest import Reference


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, dq, ddq = np.random.default_rng(2).uniform(-2, 2, (3, 57, 6))
    return q, dq, ddq


def test_the_nominal_model_is_the_robot(reference: Reference) -> None:
    model = sgpr.Model.nominal(reference.robot)
    tau = model.predict(reference.q, reference.dq, reference.ddq)
    if not model.effects:
        assert np.array_equal(tau, reference.robot.inverse_dynamics(reference.q, reference.dq, reference.ddq))
    assert model.robot == reference.robot
    assert (model.fit, model.report, model.processing, model.logs) == (None, None, None, [])
    assert model.parameters.covariance is None
    assert np.all(np.isnan(model.parameters.standard_deviations))
    assert np.array_equal(model.parameters.values, model.parameters.nominal)
    assert model.parameters[0].standard_deviation is None


def test_prediction_is_regressor_times_parameters(
    demo_model: sgpr.Model, motion: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    q, dq, ddq = motion
    named = dict(zip(demo_model.all_parameter_names, demo_model.all_parameters, strict=True))
    by_effect = {
        symbol: np.array([named[f"joint_{j}.{symbol}"] for j in range(1, 7)]) for symbol in ("Fv", "Fc", "Ia", "tau0")
    }
    Y = demo_model.robot.regressor(q, dq, ddq)
    tau = Y @ demo_model.all_parameters[:60]
    tau += by_effect["Fv"] * dq + by_effect["Fc"] * np.sign(dq) + by_effect["Ia"] * ddq + by_effect["tau0"]
    assert np.allclose(demo_model.predict(q, dq, ddq), tau, atol=1e-9)
    assert np.array_equal(demo_model.identified_robot.standard_parameters, demo_model.all_parameters[:60])
    one = demo_model.predict(q[3], dq[3], ddq[3])
    assert one.shape == (6,)
    assert np.array_equal(one, demo_model.predict(q, dq, ddq)[3])
    assert demo_model.predict(q[:0], dq[:0], ddq[:0]).shape == (0, 6)


def test_a_model_from_parameters() -> None:
    robot = sgpr.robots.two_link()
    parameters = np.concatenate([robot.standard_parameters, [1.0, 2.0, 3.0, 4.0]])
    model = sgpr.Model.from_parameters(robot, parameters, ["rotor_inertia", "viscous_friction"])
    # Effects stand in the order of the registry.
    assert model.all_parameter_names[-4:] == ["joint_1.Fv", "joint_2.Fv", "joint_1.Ia", "joint_2.Ia"]
    rest = model.predict(np.zeros(2), np.zeros(2), np.zeros(2))
    assert np.allclose(model.predict(np.zeros(2), [1.0, 0.0], np.zeros(2)) - rest, [1.0, 0.0])
    with pytest.raises(sgpr.SgprError, match=r"parameters: got \(24,\), expected \(20,\)"):
        sgpr.Model.from_parameters(robot, parameters)
    with pytest.raises(sgpr.SgprError, match=r"parameters\[3\] is NaN"):
        sgpr.Model.from_parameters(robot, [0, 0, 0, np.nan] + [0] * 16)
    with pytest.raises(sgpr.IdentificationError, match="there is no effect `x`"):
        sgpr.Model.from_parameters(robot, parameters, ["x"])


def assert_same_model(a: sgpr.Model, b: sgpr.Model) -> None:
    assert np.array_equal(a.all_parameters, b.all_parameters)
    assert a.all_parameter_names == b.all_parameter_names
    assert a.effects == b.effects
    assert a.robot == b.robot
    assert a.history == b.history
    assert a.logs == b.logs
    assert np.array_equal(a.parameters.standard_deviations, b.parameters.standard_deviations, equal_nan=True)
    assert (a.parameters.covariance is None) == (b.parameters.covariance is None)
    if a.parameters.covariance is not None and b.parameters.covariance is not None:
        assert np.array_equal(a.parameters.covariance, b.parameters.covariance)
    assert repr(a.processing) == repr(b.processing)
    assert repr(a.fit) == repr(b.fit)


def test_saved_and_loaded_to_the_bit(
    demo_model: sgpr.Model, motion: tuple[np.ndarray, np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    path = tmp_path / "model.sgpr"
    demo_model.save(path)
    loaded = sgpr.load(path)
    assert_same_model(loaded, demo_model)
    assert loaded.report is None
    assert np.array_equal(loaded.predict(*motion), demo_model.predict(*motion))
    assert path.read_bytes() == demo_model.to_bytes()
    for other in (
        pickle.loads(pickle.dumps(demo_model)),
        copy.deepcopy(demo_model),
        sgpr.Model.from_bytes(demo_model.to_bytes()),
    ):
        assert_same_model(other, demo_model)


def test_files_that_hold_no_model(demo_model: sgpr.Model, tmp_path: Path) -> None:
    path = tmp_path / "model.sgpr"
    with pytest.raises(FileNotFoundError):
        sgpr.load(path)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises((FileExistsError, NotADirectoryError)):
        demo_model.save(file / "model.sgpr")
    content = demo_model.to_bytes()
    for damaged in (b"", b"nonsense", content[:-8], content[: len(content) // 2], b"\xff" * 100):
        path.write_bytes(damaged)
        with pytest.raises(sgpr.ModelFileError, match="not a torque model, or damaged"):
            sgpr.load(path)
    with pytest.raises(sgpr.ModelFileError, match=r"^mine: "):
        sgpr.Model.from_bytes(b"x", origin="mine")


def test_models_add_up(demo_model: sgpr.Model, motion: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    nominal = sgpr.Model.nominal(demo_model.robot)
    both = nominal + demo_model
    assert both.effects == demo_model.effects
    expected = nominal.predict(*motion) + demo_model.predict(*motion)
    assert np.allclose(both.predict(*motion), expected, atol=1e-9)
    assert np.array_equal(nominal.plus(demo_model).all_parameters, both.all_parameters)
    with pytest.raises(sgpr.SgprError, match="models of different robots: joints joint_1, joint_2, and joint_1"):
        sgpr.Model.nominal(sgpr.robots.two_link()) + demo_model
    with pytest.raises(TypeError):
        demo_model + 1  # type: ignore[operator]


def test_parameters_are_a_sequence(demo_model: sgpr.Model) -> None:
    parameters = demo_model.parameters
    assert len(parameters) == len(parameters.names) == len(parameters.expressions) == len(parameters.units)
    assert [parameter.name for parameter in parameters] == parameters.names
    assert parameters[-1].name == parameters.names[-1]
    parameter = parameters["joint_2.mx"]
    index = parameters.names.index("joint_2.mx")
    assert parameter.value == parameters.values[index] == parameters[index].value
    assert parameter.standard_deviation == parameters.standard_deviations[index]
    assert parameter.relative_standard_deviation == pytest.approx(
        100 * parameters.standard_deviations[index] / abs(parameter.value)
    )
    assert parameter.unit == "kg·m"
    assert parameter.expression.startswith("joint_2.mx")
    assert parameters.covariance is not None
    assert np.allclose(np.sqrt(np.diag(parameters.covariance)), parameters.standard_deviations)
    # They are the combinations of all parameters that the robot says.
    base = demo_model.robot.base_parameters(demo_model.effects)
    assert base.names == parameters.names
    assert np.allclose(base.matrix @ demo_model.all_parameters, parameters.values)
    table = parameters.to_dict()
    assert table[index]["value"] == parameter.value
    assert set(table[index]) == {
        "name",
        "expression",
        "unit",
        "value",
        "standard_deviation",
        "relative_standard_deviation",
        "nominal",
    }
    with pytest.raises(KeyError):
        parameters["nothing"]
    for place in (len(parameters), -len(parameters) - 1):
        with pytest.raises(IndexError):
            parameters[place]
    with pytest.raises(TypeError):
        parameters[1.5]  # type: ignore[index]
    assert parameters._repr_html_().count("<tr>") == len(parameters) + 1
    assert len(repr(parameters).splitlines()) == len(parameters) + 1
    with pytest.raises(AttributeError):
        parameter.value = 3.0  # type: ignore[misc]


def test_parameters_are_the_rows_of_a_table(demo_model: sgpr.Model) -> None:
    parameters = demo_model.parameters
    assert [one.name for one in parameters] == parameters.names
    assert [dataclasses.asdict(one) for one in parameters] == parameters.to_dict()
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(parameters)
    assert list(table.columns) == list(parameters.to_dict()[0])
    assert np.array_equal(table["value"], parameters.values)


def test_all_parameters_are_a_view(demo_model: sgpr.Model) -> None:
    values = demo_model.all_parameters
    assert np.shares_memory(values, demo_model.all_parameters)
    assert not values.flags.writeable


def test_the_predictor_predicts_the_same(
    demo_model: sgpr.Model, motion: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    predictor = demo_model.predictor()
    expected = demo_model.predict(*motion)
    out = np.empty(6)
    for k, sample in enumerate(zip(*motion, strict=True)):
        assert predictor.torque(*sample, out=out) is out
        assert np.allclose(out, expected[k], rtol=0, atol=1e-11)
        assert np.array_equal(predictor.torque(*sample), out)


def test_the_predictor_writes_where_it_is_told(demo_model: sgpr.Model) -> None:
    predictor = demo_model.predictor()
    q, zero = np.full(6, 0.3), np.zeros(6)
    tau = predictor.torque(q, zero, zero)
    # Into a row of a larger array, and over one of its inputs.
    table = np.zeros((3, 6))
    predictor.torque(q, zero, zero, out=table[1])
    assert np.array_equal(table[1], tau)
    assert not table[[0, 2]].any()
    assert predictor.torque(q, zero, zero, out=q) is q
    assert np.array_equal(q, tau)


def test_outputs_that_cannot_be_written(demo_model: sgpr.Model) -> None:
    predictor = demo_model.predictor()
    zero = np.zeros(6)
    with pytest.raises(sgpr.SgprError, match=r"out: got \(5,\), expected \(6,\)"):
        predictor.torque(zero, zero, zero, out=np.zeros(5))
    with pytest.raises(sgpr.SgprError, match="out: expected a contiguous array"):
        predictor.torque(zero, zero, zero, out=np.zeros(12)[::2])
    locked = np.zeros(6)
    locked.flags.writeable = False
    with pytest.raises(sgpr.SgprError, match="out: "):
        predictor.torque(zero, zero, zero, out=locked)
    for wrong in (np.zeros(6, np.float32), np.zeros((1, 6)), [0.0] * 6):
        with pytest.raises(TypeError, match=r"out: expected an array \(n,\) of float64"):
            predictor.torque(zero, zero, zero, out=wrong)  # type: ignore[arg-type]
    with pytest.raises(sgpr.SgprError, match=r"q\[2\] is NaN"):
        predictor.torque([0, 0, np.nan, 0, 0, 0], zero, zero)  # type: ignore[arg-type]
    with pytest.raises(sgpr.SgprError, match=r"dq: got \(1, 6\), expected \(6,\)"):
        predictor.torque(zero, np.zeros((1, 6)), zero)


def test_a_predictor_may_be_shared_by_accident(demo_model: sgpr.Model) -> None:
    predictor = demo_model.predictor()
    q = np.random.default_rng(4).uniform(-1, 1, (4, 6))
    zero = np.zeros(6)
    expected = [predictor.torque(row, zero, zero).copy() for row in q]
    wrong = []

    def work(k: int) -> None:
        for _ in range(500):
            if not np.array_equal(predictor.torque(q[k], zero, zero), expected[k]):
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
