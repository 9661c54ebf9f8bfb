"""Names of effects on the command line."""

from collections.abc import Sequence

from .. import effects as registry
from .errors import one_of

DEFAULT_EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")


def checked_effects(names: Sequence[str], option: str = "--effects") -> list[str]:
    """The effects, each once, as `effect` or `effect@joint`; `none` stands for no effect."""
    if list(names) == ["none"]:
        return []
    known = [effect["name"] for effect in registry()]
    for name in names:
        one_of(name.partition("@")[0], known, option, "effect")
    return list(dict.fromkeys(names))
