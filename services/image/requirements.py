# ruff: noqa: INP001 - a script, no part of a package
"""Print what pyproject.toml in this folder needs to build and to run, one requirement a line.

An image installs these before eskin's own code is copied, so that a change of code does not install
them again.
"""

import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text())
for requirement in project["build-system"]["requires"] + project["project"]["dependencies"]:
    sys.stdout.write(f"{requirement}\n")
