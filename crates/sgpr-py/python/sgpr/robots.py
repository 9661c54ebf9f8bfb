"""Robots of the literature, ready to use, and their drives."""

from ._sgpr import puma560, puma560_drives, two_link, two_link_drives

__all__ = ["puma560", "puma560_drives", "two_link", "two_link_drives"]
