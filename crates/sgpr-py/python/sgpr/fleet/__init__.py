"""Many arms and long logs: records of logs in files, made by many workers, and what changed in which arm.

A record (`sgpr.record`) is what a log says about the parameters of a robot. Everything here works on records; the logs
are read once.
"""

from .files import load_records, save_records
from .long_logs import read_pieces, record_pieces
from .simulated import simulate_fleet

__all__ = ["load_records", "read_pieces", "record_pieces", "save_records", "simulate_fleet"]
