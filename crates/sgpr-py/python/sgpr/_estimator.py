"""What scikit-learn expects of an estimator, without needing it."""

import inspect
from typing import Any, Self

import numpy as np

from ._sgpr import SgprError


class NotFittedError(SgprError, AttributeError):
    """The estimator has to be fitted first."""


class Estimator:
    """Parameters are those of `__init__`, stored under their names; what is learned ends in an underscore."""

    @classmethod
    def _parameter_names(cls) -> list[str]:
        parameters = list(inspect.signature(cls.__init__).parameters.values())[1:]
        return sorted(parameter.name for parameter in parameters)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters of this estimator.

        Parameters
        ----------
        deep : bool
            For scikit-learn; there is nothing within.

        Returns
        -------
        dict
        """
        return {name: getattr(self, name) for name in self._parameter_names()}

    def set_params(self, **params: Any) -> Self:
        """Set parameters of this estimator.

        Parameters
        ----------
        **params
            As `get_params` gives them.

        Returns
        -------
        the estimator
        """
        known = self._parameter_names()
        for name, value in params.items():
            if name not in known:
                raise SgprError(f"there is no parameter '{name}'; known are {', '.join(known)}")
            setattr(self, name, value)
        return self

    def _require_fitted(self, attribute: str) -> Any:
        try:
            return vars(self)[attribute]
        except KeyError:
            message = f"this {type(self).__name__} is not fitted yet: call fit first"
            raise _not_fitted()(message) from None

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        shown = [
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if not (value is defaults[name].default or _same(value, defaults[name].default))
        ]
        return f"{type(self).__name__}({', '.join(shown)})"


def _same(a: Any, b: Any) -> bool:
    return type(a) is type(b) and np.isscalar(a) and bool(a == b)


def _not_fitted() -> type[Exception]:
    """scikit-learn's exception where it is installed and in use, for its tools look for it."""
    import sys

    module = sys.modules.get("sklearn.exceptions")
    if module is None:
        return NotFittedError
    return type("NotFittedError", (NotFittedError, module.NotFittedError), {"__module__": __name__})
