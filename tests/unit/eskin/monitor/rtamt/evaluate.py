"""Runs in rtamt's environment: evaluates formulas over equally spaced samples.

Reads a JSON list of objects: ``formula``, and ``signals`` with the values of each variable. Writes
the robustness of each formula at each sample.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

import rtamt


def robustness(asked: dict[str, Any]) -> list[float]:
    """Of a formula at each sample; beyond its first and last ones nothing is looked at."""
    specification = rtamt.StlDiscreteTimeSpecification()
    for name in asked["signals"]:
        specification.declare_var(name, "float")
    specification.spec = asked["formula"]
    specification.parse()
    count = len(next(iter(asked["signals"].values())))
    found = specification.evaluate({"time": list(range(count))} | asked["signals"])
    return [max(-1e9, min(1e9, value)) for _, value in found if not math.isnan(value)]


if __name__ == "__main__":
    json.dump([robustness(asked) for asked in json.load(sys.stdin)], sys.stdout)
