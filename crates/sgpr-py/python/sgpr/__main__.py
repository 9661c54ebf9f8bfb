"""`python -m sgpr`."""

from .cli import main

main()
