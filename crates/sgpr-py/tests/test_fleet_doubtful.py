"""Sessions that are not what they seem are left out or told apart by name; findings in logs come with records."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sgpr
from sgpr.fleet import changes
from sgpr.fleet.simulated import Arm, Fault, session_log
from sgpr.report.fleet import FleetPage

pytestmark = pytest.mark.filterwarnings("ignore")

ROBOT = sgpr.robots.two_link()
NANOSECONDS_PER_YEAR = round(365.25 * 86_400e9)
Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def processing() -> sgpr.Processing:
    log = session_log(Arm("arm", "two", 100), ROBOT, 0, 2, tracked=False)
    return sgpr.choose_processing(ROBOT, [recording_of(log)])


def recording_of(log: Mapping[str, Any]) -> sgpr.Recording:
    return sgpr.Recording(log["t"], log["q"], tau=log["tau"], joint_names=ROBOT.joint_names)


def recorded(
    processing: sgpr.Processing,
    name: str,
    seed: int,
    spoil: Mapping[int, Change],
    *,
    tool: float = 0.0,
    sessions: int = 16,
) -> list[sgpr.Record]:
    """Records of an arm, some logs spoiled; every second session carries `tool` kg more under the same name."""
    records = []
    for k in range(sessions):
        faults = (Fault("tool", 1, 0, tool),) if k % 2 and tool else ()
        log = session_log(replace(Arm(name, "two", seed), faults=faults), ROBOT, k, 2, tracked=False)
        spoil.get(k, lambda log: None)(log)
        labels = {"robot": name, "type": "two", "session": f"{k:04d}", "tool": "gripper"}
        records.append(sgpr.record(ROBOT, recording_of(log), processing=processing, labels=labels, blocks=1))
    return records


def with_labels(record: sgpr.Record, **labels: str) -> sgpr.Record:

    head, numbers = record.to_parts()
    data = json.loads(head)
    data["labels"].update(labels)
    return sgpr.Record.from_parts(json.dumps(data), numbers)


def test_clocks_doubles_and_sessions_of_two_arms_are_left_out_by_name(processing: sgpr.Processing) -> None:
    def unset(log: dict[str, Any]) -> None:
        log["t"] = log["t"] - log["t"][0]

    def ahead(log: dict[str, Any]) -> None:
        log["t"] = log["t"] + 40 * NANOSECONDS_PER_YEAR

    first = recorded(processing, "arm 0", 100, {5: unset, 7: ahead})
    second = recorded(processing, "arm 1", 101, {})
    # The same motion of the same time in other digits, and a part of it.
    log = session_log(Arm("arm 0", "two", 100), ROBOT, 9, 2, tracked=False)
    rounded = recording_of({**log, "tau": log["tau"].round(4)})
    part = recording_of({key: values[:1500] for key, values in log.items()})
    for name, recording in (("rounded", rounded), ("part", part)):
        labels = {"robot": "arm 0", "type": "two", "session": name, "tool": "gripper"}
        first.append(sgpr.record(ROBOT, recording, processing=processing, labels=labels, blocks=1))
    first.append(with_labels(second[3], robot="arm 0", session="of the other"))
    found = {history.robot: history for history in changes.histories([*first, *second], {"two": ROBOT})}
    reasons = found["arm 0"].left_out
    assert set(reasons) == {"0005", "0007", "rounded", "part", "of the other"}
    assert "clock says 1970-01-01" in reasons["0005"] and "clock says 2066" in reasons["0007"]
    assert "0009 is of the same time" in reasons["rounded"] and "0009 is of the same time" in reasons["part"]
    assert "a session of arm 1, too" in reasons["of the other"] and set(found["arm 1"].left_out) == {"0003"}
    assert [len(found[f"arm {k}"].time) for k in (0, 1)] == [14, 15]
    assert not found["arm 0"].alarms and not found["arm 1"].alarms
    # For machines, and on the page: each by name.
    data = changes.to_dict(found["arm 0"])
    page = FleetPage(list(found.values()), {}, {}, 0.5, {"sgpr": "0"}).html()
    assert data["left_out"] == reasons and all(reason in page for reason in reasons.values())
    assert "6 logs set aside" in page


def test_stamps_from_zero_are_no_wrong_clock_and_no_overlap(processing: sgpr.Processing) -> None:
    def from_zero(log: dict[str, Any]) -> None:
        log["t"] = log["t"] - log["t"][0]

    history = changes.histories(
        recorded(processing, "arm", 100, dict.fromkeys(range(8), from_zero), sessions=8), {"two": ROBOT}
    )[0]
    assert history.left_out == {} and len(history.time) == 8


def test_two_tools_under_one_name_are_told_and_measured_apart(processing: sgpr.Processing) -> None:
    records = recorded(processing, "arm", 102, {}, tool=0.8, sessions=24)
    history = changes.histories(records, {"two": ROBOT})[0]
    (text,) = history.mixed
    assert "12 of 24 sessions carry 0.80 kg more" in text and "two tools under one name" in text
    assert not history.alarms, [alarm.text for alarm in history.alarms]
    assert np.nanmax(history.error) < 0.1
    # One that came and stayed is a change, not a second tool.
    stays = recorded(processing, "arm", 102, {}, sessions=12)
    stays += [
        with_labels(one, session=f"{12 + k:04d}")
        for k, one in enumerate(recorded(processing, "arm", 102, {}, tool=0.8, sessions=24)[13::2])
    ]
    history = changes.histories(stays, {"two": ROBOT})[0]
    assert history.mixed == [] and [alarm.cause for alarm in history.alarms] == ["tool"]


def test_findings_come_with_the_records(processing: sgpr.Processing) -> None:
    def frozen(log: dict[str, Any]) -> None:
        log["tau"][500:900, 0] = log["tau"][500, 0]

    def later(log: dict[str, Any]) -> None:
        log["t"][1000:] += 3_600_000_000_000

    records = recorded(processing, "arm", 100, {6: frozen, 7: frozen, 9: later}, sessions=12)
    kinds = {(one["kind"], one["rank"], one["subject"]) for record in records for one in record.screening}
    assert {("frozen_torque", "look", "joint_1_torque"), ("gap", "look", None)} <= kinds
    assert [one["message"] for one in records[6].screening] == records[6].findings
    history = changes.histories(records, {"two": ROBOT})[0]
    found = {(one["kind"], one["subject"]): one for one in changes.to_dict(history)["findings"]}
    assert (found["frozen_torque", "joint_1_torque"]["sessions"], found["gap", None]["sessions"]) == (2, 1)
    assert found["frozen_torque", "joint_1_torque"]["first"] == "0006"
    page = FleetPage([history], {}, {}, 0.5, {"sgpr": "0"}).html()
    assert "frozen torque" in page and "2 of 12" in page and "joint_1_torque" in page


def test_findings_of_records_of_an_earlier_version_are_sentences(processing: sgpr.Processing) -> None:

    head, numbers = recorded(processing, "arm", 100, {}, sessions=1)[0].to_parts()
    old = sgpr.Record.from_parts(json.dumps({**json.loads(head), "version": 2, "findings": ["a gap"]}), numbers)
    assert old.findings == ["a gap"]
    assert old.screening == [{"kind": "unnamed", "rank": "know", "subject": None, "message": "a gap"}]
