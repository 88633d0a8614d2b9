"""``python -m haptix.cli``."""

from haptix.cli import main

main()
