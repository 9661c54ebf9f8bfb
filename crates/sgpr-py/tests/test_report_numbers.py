"""Numbers as people read them."""

import math

import pytest
from sgpr.report.numbers import percent, readable, relative_deviation, significant, with_deviation


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.23456, "1.23"),
        (123456.0, "123456"),
        (0.00012345, "0.000123"),
        (1.5e-7, "1.50e-07"),
        (9.999, "10.0"),
        (-2.0, "-2.00"),
        (math.inf, "∞"),
        (math.nan, "–"),
        (None, "–"),
        (1e9, "1.00e+09"),
    ],
)
def test_significant(value: float | None, text: str) -> None:
    assert significant(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0.00"), (4.217, "4.22"), (12.34, "12.3"), (123.4, "123"), (99.99, "100")]
)
def test_percent(value: float, text: str) -> None:
    assert percent(value) == text


@pytest.mark.parametrize(("value", "text"), [(4.217, "4.22"), (999.0, "999"), (3.7e10, "> 1000"), (None, "–")])
def test_relative_deviation(value: float | None, text: str) -> None:
    assert relative_deviation(value) == text


@pytest.mark.parametrize(
    ("value", "deviation", "texts"),
    [
        (3.14159, 0.0123, ("3.142", "0.012")),
        (3.14159, 0.0996, ("3.14", "0.10")),
        (1234.5, 56.0, ("1234", "56")),
        (-1e-12, 0.037, ("0.000", "0.037")),
        (0.5, math.inf, ("0.5000", "–")),
        (0.5, None, ("0.5000", "–")),
        (-8.17e-6, 2.1e-7, ("-8.17e-06", "2.1e-07")),
    ],
)
def test_with_deviation(value: float, deviation: float | None, texts: tuple[str, str]) -> None:
    assert with_deviation(value, deviation) == texts


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        ("a.m", "a.m"),
        ("a.m + 0.25 b.m - b.Ixx", "a.m + 0.25 b.m - b.Ixx"),
        ("a.Fv - 0.000000001774 b.Ia + c.m", "a.Fv + c.m"),
        ("a.m + 1.2e-9 b.m", "a.m"),
        ('first joint.m + 0.25 the 2nd, "odd" one.m', 'first joint.m + 0.25 the 2nd, "odd" one.m'),
        ("first joint.m - 1e-9 second joint.m", "first joint.m"),
        ("a\nb.m + 2 <a href='x'>.m", "a\nb.m + 2 <a href='x'>.m"),
    ],
)
def test_specks_are_left_out_of_expressions(expression: str, text: str) -> None:
    assert readable(expression) == text
