"""Who samples together again: members that are set alike, whatever way they came there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.machine.crystal import BILLION
from eskin_sensor_node.machine.events import NEVER

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.fleet.cohort import Key, Share
    from eskin_sensor_node.fleet.roster import Roster
    from eskin_sensor_node.fleet.single_node import SingleNode

QUIET: Final = 2 * BILLION
"""ns without a command to any of them: a command to a whole fleet comes to one after the other."""
_LONGEST: Final = 30 * BILLION
"""ns after which those wait no more who were set first."""


class Regroup:
    """Brings members of a roster into cohorts by their keys.

    Args:
        roster: Whose they are.
    """

    def __init__(self, roster: Roster) -> None:
        self._roster = roster
        self._first = self._latest = NEVER

    def await_more(self, now: int) -> None:
        """Somebody was set at a moment of the monotonic clock, ns; others may be, too."""
        self._first, self._latest = min(self._first, now), now

    def is_due(self, now: int) -> bool:
        """Whether those who were set have waited long enough."""
        return self._first != NEVER and now >= min(self._first + _LONGEST, self._latest + QUIET)

    def gather(
        self, cohorts: list[Cohort], singles: Mapping[int, SingleNode], now: int
    ) -> list[int]:
        """Change cohorts so that each key has one, of which half are there at least.

        Where something changed it looks once more: who came from another cohort may stand a frame
        apart until both have sampled. So it does while somebody looks at one of them.

        Args:
            cohorts: All of the roster; changed.
            singles: Those who sample alone.
            now: On the monotonic clock, ns.

        Returns:
            Numbers of the singles that are in a cohort now.
        """
        self._first = self._latest = NEVER
        shares: dict[Key, list[Share]] = {}
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
        if shares or any(node.looked_at for node in singles.values()):
            self.await_more(now)
        return joined


def _is_thin(cohort: Cohort) -> bool:
    return 2 * len(cohort) < len(cohort.numbers)
