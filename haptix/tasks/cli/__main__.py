"""``python -m haptix.tasks.cli``."""

from haptix.tasks.cli import main

main()
