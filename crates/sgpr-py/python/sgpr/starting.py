"""The workbench from a script or a notebook."""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._workbench.running import Workbench


def workbench(*files: str | os.PathLike[str], port: int = 0, browser: bool = True) -> "Workbench":
    """Opens a page on this machine to compare models, see where they fail, and add what is missing.

    Parameters
    ----------
    *files : path
        A folder with a robot and logs, or a robot file and logs; by default the folder where the program runs.
    port : int, default 0
        On which the page is served, to this machine alone; 0 stands for any that is free.
    browser : bool, default True
        Whether to open it in the browser of the user.

    Returns
    -------
    Workbench
        It runs beside the program: `url` is its address, `stop()` ends it, `wait()` waits until Ctrl-C, and a notebook
        shows a link to it. What is done there is kept in `sgpr.toml` in the folder.

    Raises
    ------
    ImportError
        Without `pip install sgpr[workbench]`.
    SgprError
        If the port is taken, or `sgpr.toml` makes no sense.
    OSError
        If there is no such file or folder.

    Examples
    --------
    >>> bench = sgpr.workbench(browser=False)
    >>> bench.url.startswith("http://127.0.0.1:")
    True
    >>> bench.stop()
    """
    # Neither what the extra brings nor the commands are needed by those who open none.
    from ._sgpr import SgprError
    from .cli.errors import BadData

    try:
        from ._workbench.running import Workbench
    except ImportError as error:
        raise ImportError(f"{error}: pip install 'sgpr[workbench]'") from error
    try:
        running = Workbench([os.fspath(file) for file in files] or ["."], port).start()
    except BadData as error:
        raise SgprError(str(error)) from error
    if browser:
        running.open()
    return running
