"""All experiments in their order."""

from .beyond import control_laws, payload
from .experiments import (
    Settings,
    Tell,
    Thesis,
    case_1,
    case_2,
    case_2_puma,
    excitation,
    excitation_study,
    kernel_study,
    puma560,
    two_link,
)


def run(settings: Settings | None = None, tell: Tell = lambda _: None) -> Thesis:
    """All experiments; `tell` hears what is being done."""
    thesis = Thesis(settings or Settings(), {arm.name: arm for arm in (puma560(), two_link())})
    for arm in thesis.arms.values():
        excitation(thesis, arm, tell)
    for arm in thesis.arms.values():
        case_1(thesis, arm, tell)
    kernel_study(thesis, tell)
    excitation_study(thesis, tell)
    case_2(thesis, tell)
    case_2_puma(thesis, tell)
    control_laws(thesis, tell)
    payload(thesis, tell)
    return thesis
