"""What is suspicious in the training logs, seen by the physics of the robot."""

from collections.abc import Sequence

from .markup import Html, items, join, paragraph, prose


def screening_section(texts: Sequence[str]) -> Html:
    """Signs, units, delays, outliers, leverage, saturation and weak excitation, one sentence each."""
    looked_for = paragraph(
        "All joints share the same bodies, so a torque that is negated, in another unit or late contradicts the "
        "others. Looked for beside these: rows far off the model, seconds on which much of the estimate hangs, torques "
        "and positions at or beyond their limits, and combinations that the motion hardly excites.",
        "soft",
    )
    if not texts:
        return join([looked_for, paragraph("Nothing suspicious was found.")])
    return join([looked_for, items(map(prose, texts))])
