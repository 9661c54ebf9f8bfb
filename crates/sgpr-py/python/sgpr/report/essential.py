"""Which base parameters the data do not support, and what leaving them out costs."""

from collections.abc import Sequence
from typing import Any

from .markup import Cell, Html, join, paragraph, table
from .numbers import counted, significant


def essential_section(essential: dict[str, Any], names: Sequence[str]) -> Html:
    """The parameters that were left out, least missed first, with both tests that decided.

    - `names`: base parameters
    """
    dropped = [names[index] for index in essential["dropped"]]
    if not dropped:
        return paragraph(f"The data support all {counted(len(names), 'base parameter')}; none is left out.")
    rows = [
        [
            str(count),
            name,
            Cell(significant(rise, 3), "number"),
            Cell(significant(limit, 3), "number"),
            Cell(f"{100.0 * (error - 1.0):+.2f}", "number"),
        ]
        for count, (name, rise, limit, error) in enumerate(
            zip(dropped, essential["rise"], essential["limit"], essential["validation"][1:], strict=False), start=1
        )
    ]
    columns = ["left out", "parameter", "squared residual grows by", "chance, 95 %", "error on data kept out, %"]
    return join(
        [
            paragraph(
                f"{counted(len(dropped), 'base parameter')} of {len(names)} left out, least missed first: they are "
                "zero in the model. The squared residual, in units of its variance, may grow by what chance allows if "
                "all that went are zero (chi-squared, to which the F-test comes down with so many rows), and parts of "
                "the logs predicted from the others must not be predicted worse; the last column is the change of that "
                "error with all parameters up to this one left out."
            ),
            table("Parameters left out", columns, rows, text_columns=(1,)),
        ]
    )
