"""Builds the dashboard into wheels and source distributions; all else is in pyproject.toml."""

import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

HERE = Path(__file__).parent
SOURCE = HERE / "cloud" / "dashboard"
BUILT = HERE / "cloud" / "eskin_cloud" / "dashboard" / "index.html"


def build_dashboard() -> None:
    """Bundle the dashboard, unless that was done or its sources are not here, as in an image."""
    if SOURCE.exists() and not BUILT.exists():
        npm = [HERE / "services" / "npm.sh", SOURCE.relative_to(HERE)]
        for arguments in (["ci"], ["run", "build"]):
            subprocess.run([*npm, *arguments], check=True)  # noqa: S603 - a script of ours


class Source(sdist):
    """A source distribution with the bundle, so that a wheel made of it needs no Node.js."""

    def run(self) -> None:
        """Build the dashboard first."""
        build_dashboard()
        super().run()


class Package(build_py):
    """A wheel with the bundle; an editable install serves what ``make dashboard`` built."""

    def run(self) -> None:
        """Build the dashboard first."""
        if not self.editable_mode:
            build_dashboard()
        super().run()


setup(cmdclass={"build_py": Package, "sdist": Source})
