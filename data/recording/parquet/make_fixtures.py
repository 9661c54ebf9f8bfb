"""Writes the Parquet fixtures of the recording tests with a package that is not ours.

    pip install pyarrow
    python make_fixtures.py

The numbers follow formulas (`state` below) that the Rust tests repeat.
"""

import decimal
import json
import math
from pathlib import Path

import pyarrow as arrow
import pyarrow.parquet as parquet

HERE = Path(__file__).parent
START = 1_700_000_000_123_456_789
PERIOD = 10_000_000
ROWS = 30


def state(k, joint):
    """Position, velocity and torque of joint 0, 1 in sample k."""
    t = k * PERIOD * 1e-9
    return math.sin(t + joint), math.cos(t + joint), 10.0 * (joint + 1) - t


def column(quantity, joint):
    return [state(k, joint)[quantity] for k in range(ROWS)]


def lists(quantity):
    return arrow.array([[state(k, joint)[quantity] for joint in range(2)] for k in range(ROWS)])


def kinds():
    """A column of each type, in groups of seven rows."""
    whole = [None if k == 3 else k * 1000 for k in range(ROWS)]
    table = {
        "timestamp": arrow.array([START + k * PERIOD for k in range(ROWS)], arrow.timestamp("ns", tz="UTC")),
        "q_1": column(0, 0),
        "q_2": column(0, 1),
        "tau_1": column(2, 0),
        "tau_2": column(2, 1),
        "float": arrow.array(column(1, 0), arrow.float32()),
        "half": arrow.array([k / 4 for k in range(ROWS)], arrow.float16()),
        "decimal": arrow.array([decimal.Decimal(k).scaleb(-2) for k in range(ROWS)], arrow.decimal128(9, 2)),
        "whole": arrow.array(whole, arrow.int32()),
        "large": arrow.array([2**64 - 1 - k for k in range(ROWS)], arrow.uint64()),
        "enabled": [k % 3 == 0 for k in range(ROWS)],
        "note": ["text"] * ROWS,
    }
    parquet.write_table(arrow.table(table), HERE / "kinds.parquet", row_group_size=7, compression="gzip")


def times():
    """A duration as time, in rows one of which has no position."""
    q = column(0, 0)
    q[2] = None
    table = {"time": arrow.array([k * PERIOD // 1000 for k in range(ROWS)], arrow.duration("us")), "q_1": q}
    parquet.write_table(arrow.table(table), HERE / "times.parquet", compression="lz4")


def arrays():
    """A list in each row."""
    stamps = arrow.array([START + k * PERIOD for k in range(ROWS)], arrow.timestamp("ns"))
    fixed = [state(k, joint)[2] for k in range(ROWS) for joint in range(2)]
    table = {
        "timestamp": stamps,
        "position": lists(0),
        "velocity": lists(1).cast(arrow.large_list(arrow.float64())),
        "effort": arrow.FixedSizeListArray.from_arrays(arrow.array(fixed), 2),
        "load": column(2, 0),
        "note": ["text"] * ROWS,
    }
    parquet.write_table(arrow.table(table), HERE / "lists.parquet", row_group_size=8, compression="zstd")
    # Equal numbers take no room: two million in a few bytes.
    many = arrow.table({"t": [0.0, 1.0], "q": arrow.array([[0.0] * 1_000_000] * 2)})
    parquet.write_table(many, HERE / "many.parquet")
    uneven = arrow.table({"t": [0.0, 1.0], "q": arrow.array([[0.0, 1.0], [0.0]])})
    parquet.write_table(uneven, HERE / "uneven.parquet")


def lerobot():
    """Two episodes in one file; names in a table that numbers them."""
    folder = HERE / "lerobot"
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True, exist_ok=True)
    (folder / "meta").mkdir(exist_ok=True)
    info = {
        "codebase_version": "v3.0",
        "fps": 100,
        "features": {
            "observation.state": {"names": {"motors": ["shoulder.pos", "elbow.pos"]}},
            "observation.effort": {"names": {"shoulder": 0, "elbow": 1}},
            "action": {"names": None},
        },
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=1) + "\n")
    tables = [
        arrow.table(
            {
                "observation.state": arrow.array(
                    [[state(k, joint)[0] + episode for joint in range(2)] for k in range(ROWS)]
                ),
                "observation.effort": lists(2),
                "action": lists(1),
                "timestamp": arrow.array([k / 100 for k in range(ROWS)], arrow.float32()),
                "frame_index": list(range(ROWS)),
                "episode_index": [episode] * ROWS,
                "task": ["pick"] * ROWS,
            }
        )
        for episode in range(2)
    ]
    parquet.write_table(arrow.concat_tables(tables), chunk / "file-000.parquet")


kinds()
times()
arrays()
lerobot()
