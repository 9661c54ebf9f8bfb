"""Robots of the literature, ready to use."""

from ._sgpr import puma560, two_link

__all__ = ["puma560", "two_link"]
