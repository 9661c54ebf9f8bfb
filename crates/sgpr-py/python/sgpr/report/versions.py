"""What made a result."""

import platform

import numpy as np

from .. import __version__


def versions() -> dict[str, str]:
    """Versions of the software that a result depends on."""
    return {
        "sgpr": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": f"{platform.system()} {platform.machine()}",
    }
