"""What the formats of robots have a place for, and what of a model they leave out."""

from .. import Model

IN_ROBOT_FILES = {
    "mjcf": ("rotor_inertia", "viscous_friction", "coulomb_friction"),
    "urdf": ("viscous_friction", "coulomb_friction"),
}
"""Effects that the formats have a place for."""


def without_place(language: str, model: Model) -> list[str]:
    """Effects of the model that a robot file does not tell of."""
    effects = [*model.effects, *(term["effect"] for term in model.terms)]
    return [effect for effect in dict.fromkeys(effects) if effect not in IN_ROBOT_FILES[language]]
