"""Public logs of real robots, by name: downloaded from their origin, checked, and converted to columns that sgpr reads.

>>> sgpr.datasets.names()[:3]
['baxter', 'emps', 'kuka_lwr']
>>> sgpr.datasets.describe("emps").licence
'public benchmark, free with citation; this copy lies in a repository under Apache-2.0'

`emps = fetch("emps", "emps")` downloads one into a folder; then `emps.load_robot()` and `emps.recordings("train")` are
what `sgpr.identify` takes.

None of these logs is part of sgpr: their licences differ, and some state none. `describe` says whose they are.
Downloading needs `pip install "sgpr[datasets]"`.
"""

from ._dataset import Dataset, DatasetError, Fetched, Log, Source
from ._fetch import fetch
from ._registry import describe, names

__all__ = ["Dataset", "DatasetError", "Fetched", "Log", "Source", "describe", "fetch", "names"]
