"""Public logs of real robots, by name: downloaded from their origin, checked, and converted to columns that sgpr reads.

>>> sgpr.datasets.names()
['baxter', 'emps', 'kuka_lwr', ...]
>>> emps = sgpr.datasets.fetch("emps", "emps")
>>> model = sgpr.identify(emps.load_robot(), emps.recordings("train"), effects=emps.dataset.effects)
>>> sgpr.compare(model, emps.recordings("test"))

None of these logs is part of sgpr: their licences differ, and some state none. `describe` says whose they are.
Downloading needs `pip install "sgpr[datasets]"`.
"""

from ._dataset import Dataset, DatasetError, Fetched, Log, Source
from ._fetch import fetch
from ._registry import describe, names

__all__ = ["Dataset", "DatasetError", "Fetched", "Log", "Source", "describe", "fetch", "names"]
