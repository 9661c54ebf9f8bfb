"""The building blocks of the reports."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sgpr.report.diagnosis import in_one_line
from sgpr.report.errors import verdict
from sgpr.report.markup import Cell, Html, Section, element, paragraph, table
from sgpr.report.page import page
from sgpr.report.steps import steps_at_once
from sgpr.report.torque import kept_samples, uncounted


def test_text_is_escaped() -> None:
    assert paragraph("<script>&") == "<p>&lt;script&gt;&amp;</p>"
    assert element("p", Html("<b>x</b>"), title='"') == '<p title="&quot;"><b>x</b></p>'
    assert "&lt;joint&gt;" in table("errors", ["joint"], [["<joint>"], [Cell("<x>", "bad")]])


def test_a_page_holds_its_data_and_loads_nothing() -> None:
    hostile = "</script><script>alert(1)</script>"
    text = page("Title <1>", paragraph("lead"), [Section("a", "First", paragraph("x"))], {"figures": {}, "x": hostile})
    assert hostile not in text
    start = text.index('id="payload">') + len('id="payload">')
    assert json.loads(text[start : text.index("</script>", start)])["x"] == hostile
    assert "Title &lt;1&gt;" in text
    assert 'href="#a"' in text
    head = text[: text.index('id="payload"')]
    assert "http" not in head.replace("http-equiv", "")
    assert "src=" not in head


def test_extremes_survive_thinning() -> None:
    values = np.sin(np.linspace(0.0, 50.0, 100_000))
    values[31_415] = 7.0
    values[27_182] = -7.0
    values[50_000] = np.nan
    keep = kept_samples([values, -values], 1000)
    assert len(keep) <= 1003
    assert {31_415, 27_182, 50_000, 0, 99_999} <= set(keep.tolist())
    assert np.array_equal(kept_samples([values[:100]], 1000), np.arange(100))


def test_the_page_knows_the_samples_that_are_not_counted_by_their_times() -> None:
    # 19.996 s is more in four bytes than in eight: the last sample must not leave its band.
    time = np.arange(5000) / 250.0
    counted = np.ones(5000, dtype=bool)
    counted[:3] = counted[100] = counted[-4:] = False
    shown = time.astype(np.float32)
    inside = np.zeros(5000, dtype=bool)
    for begin, end in uncounted(time, counted):
        inside |= (shown >= begin) & (shown <= end)
    assert np.array_equal(inside, ~counted)


def test_numbers_that_are_not_finite_are_no_json() -> None:
    with pytest.raises(ValueError, match="JSON"):
        page("t", "", [], {"x": float("nan")})


def test_an_effect_that_came_at_several_joints_at_once_is_one_step() -> None:
    before, after = {"a": 1.0, "b": 2.0}, {"a": 0.5, "b": 1.0}
    steps = [
        {"effect": None, "joints": [], "rmse": before},
        {"effect": "backlash", "joints": ["a"], "rmse": after},
        {"effect": "backlash", "joints": ["b"], "rmse": after},
        {"effect": "payload", "joints": [], "rmse": after},
    ]
    assert steps_at_once(steps) == [("the model", before), ("+ backlash a, b", after), ("+ payload", after)]


def test_a_finding_that_is_not_certain_says_so_in_the_first_lines() -> None:
    finding = {"effect": "torque_gain_error", "joints": ["j2"], "probability": 0.5}
    named = in_one_line({**finding, "confusable_with": ["torque_gain_error@j1"]})
    assert named == "torque gain error at j2 (probability 0.50, or torque gain error at j1)"
    named = in_one_line({**finding, "confusable_with": ["external_contact", "torque_gain_error@joint_1"]})
    assert named.endswith("(probability 0.50, or external contact, or torque gain error at joint_1)")
    assert in_one_line({**finding, "confusable_with": []}) == "torque gain error at j2 (probability 0.50)"
    certain = {**finding, "probability": 0.97, "confusable_with": ["tilted_mount"]}
    assert in_one_line(certain) == "torque gain error at j2"


def test_an_error_that_grows_is_told_with_its_size_and_no_trifle_is() -> None:
    def errors(*rmse: float) -> Any:
        one = {"samples": 9, "unit": "N·m", "relative_error_percent": 1.0, "rmse_gravity": 9.0, "rmse_zero": 9.0}
        joints = [SimpleNamespace(joint=f"j{k}", rmse=value, **one) for k, value in enumerate(rmse)]
        return SimpleNamespace(joints=joints, relative_error_percent=1.0)

    told = str(verdict(errors(1.0, 1.0, 0.0), errors(1.006, 1.1, 0.1), "On 1 log", "before it was"))
    assert "Here the error has grown instead: j1 (by 10.0 %), j2." in told
    assert "grown" not in str(verdict(errors(1.0), errors(1.006), "On 1 log", "before it was"))
