"""Model files of either kind."""

from os import PathLike

from . import _sgpr
from ._sgpr import Model, ModelFileError
from .semi_parametric import SemiParametricModel


def load(path: str | PathLike[str]) -> Model | SemiParametricModel:
    """Read a model file. Safe with files from strangers: nothing in them is run.

    Parameters
    ----------
    path : path
        Of a file that `Model.save` or `SemiParametricModel.save` wrote.

    Returns
    -------
    Model or SemiParametricModel
        What the file holds.

    Raises
    ------
    ModelFileError
        If the file is no model, damaged, or of a later version.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> sgpr.Model.nominal(sgpr.robots.two_link()).save("two_link.sgpr")
    >>> sgpr.load("two_link.sgpr").robot.dof
    2
    """
    try:
        return _sgpr.load(path)
    except ModelFileError as error:
        if "its head says `sgpr semi-parametric model`" not in str(error):
            raise
        return SemiParametricModel.load(path)
