"""The command `sgpr` from its first moment: Ctrl-C ends it with a word, even while the library is still loading.

A package of its own, because whatever lies in `sgpr` is loaded after `sgpr` itself.
"""

import os
import signal
import sys

STOPPED = 130


def main() -> None:
    """Loads the command line and runs it."""
    usual = signal.getsignal(signal.SIGINT)
    # A program started in the background may be told to ignore Ctrl-C, and keeps to that.
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, stop)
    from sgpr.cli import main as run

    signal.signal(signal.SIGINT, usual)
    run()


def stop(*_: object) -> None:
    """Ends at once: an exception could get lost in what is being loaded."""
    print("sgpr: stopped; nothing was written", file=sys.stderr, flush=True)
    os._exit(STOPPED)
