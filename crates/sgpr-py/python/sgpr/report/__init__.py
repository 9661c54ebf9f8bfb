"""Reports: one HTML file each, that opens without network and looks the same every time."""

from .comparison import ComparisonPage
from .diagnosis import DiagnosisPage
from .identification import IdentificationPage

__all__ = ["ComparisonPage", "DiagnosisPage", "IdentificationPage"]
