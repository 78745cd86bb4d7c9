"""Regroups members that have equal settings into cohorts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.machine.machine import NEVER
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.fleet.cohort import CohortPart, Key
    from eskin_sensor_node.fleet.roster import Roster
    from eskin_sensor_node.fleet.single_node import SingleNode

QUIET: Final = 2 * BILLION
"""ns without a command to any of them: a command to a fleet reaches one node after the other."""
_LONGEST: Final = 30 * BILLION
"""ns after which the first member waits no longer."""


class Regroup:
    """Brings members of a roster into cohorts by their keys.

    Args:
        roster: The members'.
    """

    def __init__(self, roster: Roster) -> None:
        self._roster = roster
        self._first = self._latest = NEVER

    def postpone(self, now: int) -> None:
        """Wait for further commands after one at an instant of the monotonic clock, ns."""
        self._first, self._latest = min(self._first, now), now

    def is_due(self, now: int) -> bool:
        """Whether the members have waited long enough."""
        return self._first != NEVER and now >= min(self._first + _LONGEST, self._latest + QUIET)

    def regroup(
        self, cohorts: list[Cohort], singles: Mapping[int, SingleNode], now: int
    ) -> list[int]:
        """Change cohorts so that each key has one, of which half are there at least.

        Where something changed it tries again: a node from another cohort may stand a frame apart
        until both have sampled.

        Args:
            cohorts: All of the roster; changed.
            singles: Nodes that sample alone.
            now: On the monotonic clock, ns.

        Returns:
            Numbers of the singles that are in a cohort now.
        """
        self._first = self._latest = NEVER
        shares: dict[Key, list[CohortPart]] = {}
        joined = []
        for number, node in singles.items():
            key = node.key
            if key is not None:
                shares.setdefault(key, []).append(node.share(number))
                joined.append(number)
        alike: dict[Key, list[Cohort]] = {}
        for cohort in cohorts:
            alike.setdefault(cohort.key, []).append(cohort)
        for key, found in alike.items():
            if key in shares or len(found) > 1 or _is_thin(found[0]):
                shares[key] = [each.share() for each in found] + shares.get(key, [])
        cohorts[:] = [cohort for cohort in cohorts if cohort.key not in shares]
        cohorts += [Cohort(self._roster, each, key.order) for key, each in shares.items()]
        if shares:
            self.postpone(now)
        return joined


def _is_thin(cohort: Cohort) -> bool:
    return 2 * len(cohort) < len(cohort.numbers)
