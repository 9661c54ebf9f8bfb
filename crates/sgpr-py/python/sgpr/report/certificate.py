"""The proof that every link is a body."""

from typing import Any

from .markup import Cell, Html, items, join, paragraph, prose, table
from .numbers import percent, significant


def certificate_section(certificate: dict[str, Any]) -> Html:
    """Smallest eigenvalue, mass, centre and principal moments of each link; limits reached, and what they cost."""
    columns = [
        "link of",
        "smallest eigenvalue",
        "relative",
        "mass [kg]",
        "centre of mass [m]",
        "principal moments [kg·m²]",
    ]
    rows = [
        [
            link["joint"],
            Cell(significant(link["smallest_eigenvalue"], 3), "number"),
            Cell(significant(link["relative_eigenvalue"], 3), "number"),
            Cell(significant(link["mass"], 4), "number"),
            ", ".join(significant(value, 3) for value in link["centre"]),
            ", ".join(significant(value, 3) for value in link["principal_moments"]),
        ]
        for link in certificate["links"]
    ]
    parts = [
        paragraph(
            "A link is a body if the smallest eigenvalue of its pseudo-inertia is above zero: then some distribution "
            "of positive mass has its parameters. The relative one has lengths in units of the link's size and masses "
            "in units of its mass."
        ),
        table("Certificate", columns, rows, text_columns=(0, 4, 5)),
        paragraph(
            f"Consistency adds {significant(certificate['cost'], 3)} standard deviations (root mean square per base "
            "parameter) to the fit."
        ),
    ]
    if certificate["active"]:
        parts += [paragraph("The estimate lies at these limits:"), items(map(prose, certificate["active"]))]
    if certificate["prices"]:
        whole = percent(certificate["residual_percent"])
        parts += [
            paragraph(
                f"The weighted residual is {whole} % larger than without limits. What would be gone of that cost "
                "without one limit alone. A limit that costs much points at an effect that the model lacks, which "
                "inertias that no body has imitate."
            ),
            items(prose(f"{percent(100.0 * price['share'])} %: {price['limit']}") for price in certificate["prices"]),
            paragraph(f"Limits left out one after the other, and what is then left of the {whole} %:"),
            items(
                prose(f"{percent(stage['residual_percent'])} %: {stage['limit']}") for stage in certificate["stages"]
            ),
        ]
    if certificate["kept_out"]:
        parts.append(paragraph(kept_out(certificate["kept_out"])))
    return join(parts)


def kept_out(errors: dict[str, float]) -> str:
    """A sentence on what the limits do where the motion is new."""
    return (
        "Parts of the logs predicted from the others: error "
        f"{percent(errors['consistent_percent'])} % of the torque with the limits, "
        f"{percent(errors['unconstrained_percent'])} % without."
    )
