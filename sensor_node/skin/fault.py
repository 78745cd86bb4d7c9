"""Faults that a scenario injects: its ``[[fault]]`` tables."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field

from eskin.settings import Section


class FaultSection(Section):
    """A taxel that breaks, for good.

    A ``stuck`` one keeps the capacitance or inductance that it has at that moment; a ``dead`` one
    has an open line, so that its converter saturates.
    """

    model_config = ConfigDict(strict=True)

    taxel: str = Field(pattern=r"^t[0-9]{2,6}$", description="the one that breaks, such as t05")
    kind: Literal["stuck", "dead"] = Field(description="stuck or dead")
    at_s: float = Field(default=0.0, ge=0, description="when")
