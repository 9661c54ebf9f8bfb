"""Places for files."""

from os import PathLike
from pathlib import Path


def make_folder_of(path: str | PathLike[str]) -> None:
    """Makes the folder in which a file is to be written, if it is not there."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
