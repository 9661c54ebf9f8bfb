"""Options with several values."""

import pytest
from cli_support import run
from sgpr.cli.arguments import expand

SEVERAL = {"--train": False, "--test": False, "--torque-constants": False, "--columns": True}
TAKES_VALUE = {**dict.fromkeys(SEVERAL, 1), "--out": 1, "--trim": 2}


@pytest.mark.parametrize(
    ("written", "understood"),
    [
        ("--train a b --test c", "--train a --train b --test c"),
        ("--train=a b", "--train=a --train b"),
        ("--train a --out d f", "--train a --out d f"),
        (
            "--torque-constants -1 2.5 -3e-1 --out d",
            "--torque-constants -1 --torque-constants 2.5 --torque-constants -3e-1 --out d",
        ),
        ("--columns position=q{} torque=i{} log.csv", "--columns position=q{} --columns torque=i{} log.csv"),
        ("--trim -1 2 f --train a b", "--trim -1 2 f --train a --train b"),
        ("--train a b -- c d", "--train a --train b -- c d"),
        ("f --train", "f --train"),
        ("--out --train a b", "--out --train a b"),
    ],
)
def test_values_after_an_option_belong_to_it(written: str, understood: str) -> None:
    assert expand(written.split(), SEVERAL, TAKES_VALUE) == understood.split()


def test_an_option_without_its_values_is_named() -> None:
    found = run("identify", "--robot", "two_link", "--train", "a.csv", "--effects", "--out", "x")
    assert found.code == 2 and "--effects" in found.err and "needs a value before --out" in found.err


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("--train a.csv --rows 5000:100 --out x", "--rows: needs 2 values before --out"),
        ("--train a.csv --cutoff --out x", "--cutoff: needs a value before --out"),
        ("--train a.csv --model m.sgpr --out x", "No such option: --model"),
        ("--train a.csv --candidates=ripple --out x", "No such option: --candidates"),
        ("--train a.csv --out x b.csv", "b.csv: needs its option before it: --robot, --train, --test, --out"),
    ],
)
def test_a_mistake_is_named_and_no_other(written: str, said: str) -> None:
    found = run("identify", "--robot", "two_link", *written.split())
    text = " ".join(found.err.replace("│", " ").split())
    assert found.code == 2 and said in text, text


def test_an_effect_to_add_is_checked_first() -> None:
    found = run("diagnose", "--robot", "two_link", "--train", "a.csv", "--add", "torque_riple@joint_2", "--out", "x")
    assert found.code == 2 and "did you mean torque_ripple" in " ".join(found.err.replace("│", " ").split())


def test_help_shows_which_options_take_several_values() -> None:
    found = run("identify", "--help")
    assert found.code == 0
    for text in ("FILE...", "EFFECT...", "KEY=COLUMN...", "take several values"):
        assert text in found.out


@pytest.mark.parametrize("command", ["info", "identify", "compare", "predict"])
def test_every_command_has_the_common_options(command: str) -> None:
    found = run(command, "--help")
    assert found.code == 0
    for option in ("--json", "--quiet", "--columns", "--resample", "--trim", "--recover"):
        assert option in found.out
