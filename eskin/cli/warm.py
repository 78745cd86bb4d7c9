"""``eskin warm``: compile all kernels once, so that no first call waits for it."""

from __future__ import annotations

import time
from enum import StrEnum
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from eskin.errors import SettingsError

if TYPE_CHECKING:
    from collections.abc import Callable

    Steps: TypeAlias = dict[str, Callable[[], object]]


class WarmedPart(StrEnum):
    """What uses the kernels."""

    NOTEBOOK = "notebook"
    GATEWAY = "gateway"
    CLOUD = "cloud"
    NODE = "node"

    @property
    def package(self) -> str:
        """The package that it needs."""
        packages = {WarmedPart.NOTEBOOK: "eskin", WarmedPart.NODE: "eskin_sensor_node"}
        return packages.get(self, f"eskin_{self}")

    @property
    def is_installed(self) -> bool:
        """Whether its package is here, and for all but notebooks the extra ``stack``."""
        return find_spec(self.package) is not None and (self is WarmedPart.NOTEBOOK or _has_stack())


Parts = Annotated[
    list[WarmedPart] | None,
    typer.Argument(help="What to compile for; by default for all that is installed."),
]


def warm(parts: Parts = None) -> None:
    """Compile all kernels once and keep them on disk: about a minute the first time."""
    from rich.console import Console
    from rich.progress import Progress

    from eskin.kernels.arithmetic import add
    from eskin.kernels.jit_cache import has_cache

    for part in parts or ():
        if not part.is_installed:
            raise SettingsError("eskin warm", f"{part}: install eskin[stack] with {part.package}")
    if not has_cache(add):
        raise SettingsError(
            "eskin warm",
            "nothing can be written beside the sources; set NUMBA_CACHE_DIR to a folder that lasts",
        )
    steps: Steps = {}
    for part in parts or [each for each in WarmedPart if each.is_installed]:
        steps |= _STEPS[part]()
    began = time.monotonic()
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=len(steps))
        for name, step in steps.items():
            bar.update(task, description=f"compiling {name}")
            step()
            bar.advance(task)
    typer.echo(f"Kernels are compiled and on disk; this took {time.monotonic() - began:.1f} s.")


def _of_notebook() -> Steps:
    from eskin.warm_up import STEPS

    return STEPS | (_of_gateway() if _has_stack() else {})


def _has_stack() -> bool:
    return find_spec("cbor2") is not None


def _of_gateway() -> Steps:
    from eskin.wire.frames.warm_up import warm_up

    return {"frames": warm_up}


def _of_cloud() -> Steps:
    from eskin_cloud.warm_up import warm_up

    return {"the cloud": warm_up}


def _of_node() -> Steps:
    from eskin_sensor_node.warm_up import STEPS

    return STEPS


_STEPS: dict[WarmedPart, Callable[[], Steps]] = {
    WarmedPart.NOTEBOOK: _of_notebook,
    WarmedPart.GATEWAY: _of_gateway,
    WarmedPart.CLOUD: _of_cloud,
    WarmedPart.NODE: _of_node,
}
