"""A workbench from start to end: a free port, a token, the server, the browser."""

import secrets
import socket
import threading
import time
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import uvicorn

from ..cli.errors import BadData
from ..cli.robots import READY_MADE
from .bench import Bench
from .folder import Folder, sorted_out
from .memory import keep_none_back
from .server import application

LOOPBACK = "127.0.0.1"


PATIENCE = 1.0
"""s that the first page may take before logs are read."""


def opened(names: Sequence[str], patience: float = 0.0) -> Bench:
    """The bench of a folder, or of a robot and logs."""
    root, robot, logs = sorted_out(names or ["."])
    if not root.is_dir():
        raise BadData(f"{root}: no such folder")
    given = [*logs, *([Path(robot)] if robot and robot not in READY_MADE else [])]
    folder = Folder(root, given)
    name = robot if robot is None or robot in READY_MADE else folder.name_of(Path(robot))
    return Bench(folder, name, [folder.name_of(log) for log in logs] if logs else None, patience)


class Workbench:
    """A running workbench: `url` is its address, `stop()` ends it, `wait()` waits for its end."""

    def __init__(self, names: Sequence[str], port: int = 0) -> None:
        keep_none_back()
        self.bench = opened(names, PATIENCE)
        self._socket = _listening(port)
        self.port = self._socket.getsockname()[1]
        token = secrets.token_urlsafe(24)
        self.url = f"http://{LOOPBACK}:{self.port}/?token={token}"
        app = application(self.bench, token, self.port)
        settings = uvicorn.Config(app, log_level="error", access_log=False, lifespan="off", timeout_graceful_shutdown=1)
        self._server = uvicorn.Server(settings)
        self._thread: threading.Thread | None = None

    def run(self) -> None:
        """Serves until Ctrl-C."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._end()

    def start(self) -> "Workbench":
        """Serves beside the program."""
        self._thread = threading.Thread(
            target=self._server.run, args=([self._socket],), daemon=True, name="sgpr-server"
        )
        self._thread.start()
        while not self._server.started and self._thread.is_alive():
            time.sleep(0.01)
        return self

    def open(self) -> None:
        """Shows it in the browser."""
        webbrowser.open(self.url)

    def wait(self) -> None:
        """Waits until it is stopped, or Ctrl-C."""
        try:
            while self._thread is not None and self._thread.is_alive():
                self._thread.join(0.2)
        except KeyboardInterrupt:
            self.stop()

    def stop(self) -> None:
        """Ends it; the project file has what was done."""
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(5.0)
        self._end()

    def _end(self) -> None:
        self.bench.work.cancel()
        self.bench.work.wait(5.0)
        self._socket.close()

    def __repr__(self) -> str:
        return f"Workbench({self.url})"

    def _repr_html_(self) -> str:
        return f'<a href="{self.url}" target="_blank" rel="noopener">open the workbench</a>'


def _listening(port: int) -> socket.socket:
    place = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        place.bind((LOOPBACK, port))
    except (OSError, OverflowError) as error:
        place.close()
        raise BadData(f"port {port} is not free ({error}); choose another with --port, or leave it out") from error
    place.listen()
    return place
