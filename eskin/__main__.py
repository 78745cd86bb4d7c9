"""``python -m eskin`` is the command ``eskin``."""

from eskin.command import main

main()
