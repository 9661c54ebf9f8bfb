"""`python -m sgpr.cli`."""

from .app import main

main()
