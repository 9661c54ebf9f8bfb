"""Every experiment of S. Krishnamoorthi, Model-Based Compensation for Serial Manipulators through Semi-Parametric
Gaussian Process Regression, MSc thesis, TU Delft (2018), run again: `sgpr reproduce thesis`.
"""

from .experiments import Settings, Thesis
from .markdown import markdown
from .page import html
from .run import run

__all__ = ["Settings", "Thesis", "html", "markdown", "run"]
