"""What is suspicious in the training logs, seen by the physics of the robot."""

from collections.abc import Mapping, Sequence

from .markup import Html, items, join, paragraph, prose


def screening_section(texts: Sequence[str], known: Sequence[Mapping[str, str]]) -> Html:
    """Signs, units, delays, outliers, leverage, saturation and weak excitation, one sentence each.

    - `known`: findings of the fit that are good to know, as in identification.json; those of a log stand with it
    """
    looked_for = paragraph(
        "All joints share the same bodies, so a torque that is negated, in another unit or late contradicts the "
        "others. Looked for beside these: rows far off the model, seconds on which much of the estimate hangs, torques "
        "and positions at or beyond their limits, and combinations that the motion hardly excites.",
        "soft",
    )
    more = [one["text"] for one in known if not one["where"] and one["text"] not in texts]
    found = items(map(prose, texts)) if texts else paragraph("Nothing suspicious was found.")
    parts = [looked_for, found]
    if more:
        parts += [paragraph("Good to know, and more often right than a fault:"), items(map(prose, more))]
    return join(parts)
