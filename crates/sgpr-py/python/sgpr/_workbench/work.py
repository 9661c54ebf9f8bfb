"""Long work: one piece at a time, in a thread of its own, with progress and cancel."""

import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

from ..cli.errors import BadData
from .memory import give_back

Progress = Callable[[str, int, int], object]

SURE_AFTER = 1.0
"""s of a stage, after which its pace says how long the rest takes."""


class Cancelled(Exception):
    """The user wants no more of it."""


class Work:
    """At most one piece of work.

    - `tell`: called whenever something changed
    """

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell = tell
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: dict[str, Any] | None = None
        self._begun = 0.0
        self._of_stage = ("", 0, 0.0)

    def start(self, title: str, task: Callable[[Progress], None], failed: Callable[[str], None]) -> None:
        """Begins a piece of work.

        - `failed`: hears what went wrong, or that it was cancelled
        """
        with self._lock:
            if self._state is not None:
                raise BadData(f"busy: {self._state['title']}; cancel it first, or wait")
            self._stop.clear()
            self._begun = time.monotonic()
            self._state = {"title": title, "stage": "", "done": 0, "total": 0}
            self._of_stage = ("", 0, self._begun)
            self._thread = threading.Thread(target=self._run, args=(task, failed), daemon=True, name="sgpr-work")
        self._tell()
        self._thread.start()

    def cancel(self) -> None:
        """Stops the work at its next step."""
        self._stop.set()

    def wait(self, seconds: float | None = None) -> None:
        """Waits for its end."""
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(seconds)

    def state(self) -> dict[str, Any] | None:
        """What goes on, since how many seconds, and how many its stage still takes; None if nothing does."""
        with self._lock:
            if self._state is None:
                return None
            now = time.monotonic()
            spent = {"seconds": round(now - self._begun, 1), "left": self._left(now)}
            return {**self._state, **spent, "stops": self._stop.is_set()}

    def _left(self, now: float) -> int | None:
        """s that the stage still takes at the pace since it began; None as long as that says little."""
        assert self._state is not None, "asked before"
        _, first, begun = self._of_stage
        done, total = self._state["done"], self._state["total"]
        if done <= first or now - begun < SURE_AFTER:
            return None
        left: int = round((now - begun) * (total - done) / (done - first))
        return left

    def step(self, stage: str, done: int, total: int) -> None:
        """Tells of the progress, and ends work that was cancelled."""
        if self._stop.is_set():
            raise Cancelled
        with self._lock:
            if self._state is not None:
                if stage != self._of_stage[0] or done < self._state["done"] or total != self._state["total"]:
                    self._of_stage = (stage, done, time.monotonic())
                self._state.update(stage=stage, done=done, total=total)

    def _run(self, task: Callable[[Progress], None], failed: Callable[[str], None]) -> None:
        message = None
        try:
            task(self.step)
        except Cancelled:
            message = "cancelled; what was there before is kept"
        except (BadData, ValueError, OSError, MemoryError) as error:
            message = str(error) or type(error).__name__
        except Exception as error:
            traceback.print_exc()
            message = f"{type(error).__name__}: {error}; this is a fault of sgpr, the details are in its terminal"
        finally:
            give_back()
            with self._lock:
                self._state = None
        if message is not None:
            failed(message)
        self._tell()
