"""``python -m eskin`` is the command ``eskin``."""

from eskin.cli import main

main()
