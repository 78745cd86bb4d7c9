"""Runs in rtamt's environment: its online monitor on samples that arrive one by one.

Reads ``formula``, ``values`` of p, and how many of them are ``warm``; writes the mean time of one
of the others in us.
"""

from __future__ import annotations

import json
import sys
import time

import rtamt


def main() -> None:
    """Measure and write."""
    asked = json.load(sys.stdin)
    monitor = rtamt.StlDiscreteTimeOnlineSpecification()
    monitor.declare_var("p", "float")
    monitor.declare_var("out", "float")
    monitor.spec = f"out = {asked['formula']}"
    monitor.parse()
    monitor.pastify()
    begun = 0.0
    for k, value in enumerate(asked["values"]):
        if k == asked["warm"]:
            begun = time.perf_counter()
        monitor.update(k, [("p", value)])
    spent = time.perf_counter() - begun
    print(spent / (len(asked["values"]) - asked["warm"]) * 1e6)


if __name__ == "__main__":
    main()
