"""Names of effects on the command line."""

from collections.abc import Sequence

from .. import effects as registry
from .errors import one_of

DEFAULT_EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")


def checked_effects(names: Sequence[str], option: str = "--effects") -> list[str]:
    """The effects, each once; `none` stands for no effect."""
    if list(names) == ["none"]:
        return []
    known = [effect["name"] for effect in registry()]
    return list(dict.fromkeys(one_of(name, known, option, "effect") for name in names))
