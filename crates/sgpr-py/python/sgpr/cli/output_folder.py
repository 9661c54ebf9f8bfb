"""Results that appear all together: files are written beside their place and renamed at the end."""

import errno
import os
from pathlib import Path
from types import TracebackType

from .errors import wrong_use


class OutputFolder:
    """A folder for results. Existing files are replaced only by whole new ones, and only if all went well."""

    def __init__(self, path: str) -> None:
        """Makes the folder and finds out now whether it can be written to, not after an hour of work."""
        if not path:
            raise wrong_use("the name of the folder is empty", "--out")
        self.path = Path(path)
        if self.path.exists() and not self.path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, "this is no folder, and results need one", path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            why = f"this folder cannot be made ({error.strerror}); name another one"
            raise OSError(error.errno, why, path) from error
        self._waiting: dict[Path, Path] = {}
        probe = self._beside(self.path / "probe")
        try:
            probe.touch()
        except OSError as error:
            why = f"nothing can be written to this folder ({error.strerror}); name another one"
            raise OSError(error.errno, why, path) from error
        finally:
            # Ctrl-C can come in between.
            probe.unlink(missing_ok=True)

    def file(self, name: str) -> Path:
        """Where to write the file that shall be called `name`; anywhere else if `name` is a path of its own."""
        place = self.path / name
        self._waiting[place] = self._beside(place)
        return self._waiting[place]

    def write(self, name: str, text: str) -> None:
        """Writes a text file."""
        self.file(name).write_text(text, encoding="utf-8", newline="\n")

    def __enter__(self) -> "OutputFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for place, written in self._waiting.items():
            if kind is None:
                os.replace(written, place)
            else:
                written.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None:
            raise OSError(error.errno, error.strerror, str(self._meant(error.filename))) from error

    def _meant(self, name: str | None) -> Path:
        """The file that the user knows in the place of the one beside it; the folder if the system names none."""
        places = {str(written): place for place, written in self._waiting.items()}
        return self.path if name is None else places.get(name, Path(name))

    @staticmethod
    def _beside(place: Path) -> Path:
        # The suffix stays: it decides the format.
        return place.with_name(f".{os.getpid()}-{place.name}")
