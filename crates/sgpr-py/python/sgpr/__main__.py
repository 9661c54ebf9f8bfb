"""`python -m sgpr`."""

from sgpr_command import main

main()
