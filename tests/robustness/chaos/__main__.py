"""``make chaos``: the real stack under a seeded plan of faults.

Exit status 1 if a frame vanished or came twice, a gap has no cause, or a process died.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

from rich.console import Console

from tests.robustness.chaos.faults import FAULTS
from tests.robustness.chaos.plan import Blow, Stroke, make_plan
from tests.robustness.chaos.site import STORES, Site, part_names
from tests.robustness.chaos.verdict import DRAIN_S, judge
from tests.robustness.model.traces import check_windows, pick, vanished, windows
from tests.support.citus import NO_SOURCE, citus_programs
from tests.support.processes import ESKIN, unwound_by_signals, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.robustness.chaos.verdict import Verdict
    from tests.robustness.model.traces import Event

_START_S: Final = 180.0
_OF_ITS_OWN: Final = "ESKIN_CHAOS_NAMESPACE"


def main() -> int:
    """Run the plan, then judge."""
    parser = argparse.ArgumentParser(prog="make chaos", description=__doc__)
    parser.add_argument("--duration", type=float, default=120.0, help="seconds of faults")
    parser.add_argument("--seed", type=int, default=1, help="draws the plan")
    parser.add_argument("--data", type=Path, default=None, help="folder to keep; else a fresh one")
    parser.add_argument(
        "--store", choices=list(STORES), default="sqlite", help="what the cloud keeps in"
    )
    parser.add_argument(
        "--cluster", dest="store", action="store_const", const="cluster", help="--store cluster"
    )
    parser.add_argument(
        "--citus", dest="store", action="store_const", const="citus", help="--store citus"
    )
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.stderr.write("make chaos: network namespaces need root; run it with sudo\n")
        return 2
    if _OF_ITS_OWN not in os.environ:
        _go_into_namespaces_of_our_own()
    console = Console(stderr=True)
    recorded = options.store == "sqlite"
    plan = make_plan(options.seed, seconds=options.duration, parts=part_names(options.store))
    console.print(f"{len(plan)} faults in {options.duration:g} s, seed {options.seed}")
    with ExitStack() as exits:
        exits.enter_context(unwound_by_signals())
        programs = None
        if options.store == "citus":
            programs = exits.enter_context(citus_programs())
            if programs is None:
                sys.stderr.write(f"make chaos: {NO_SOURCE}\n")
                return 2
        # Else faults fall on compilers, and clouds wait for them instead of doing their work.
        subprocess.run([ESKIN, "warm"], stdout=sys.stderr, check=True)
        fresh = exits.enter_context(tempfile.TemporaryDirectory(prefix="eskin-chaos-"))
        root = (options.data or Path(fresh) / "site").resolve()
        with Site(root, kind=options.store, programs=programs) as site:
            wait_until(site.has_begun, "frames of all nodes are stored", seconds=_START_S)
            site.watch()
            site.raise_alarms(seed=options.seed)
            if recorded:
                site.record()
            blows = _play(site, plan, console.print)
            console.print("all faults are over; waiting until everything has arrived")
            site.drain(seconds=DRAIN_S)
            verdict = judge(site, blows)
            if recorded:
                verdict.faults += trace_faults(site.recorded(), console.print)
            site.require_alive(site.served)
        _report(verdict, plan, console.print)
        return 1 if verdict.faults else 0


def _go_into_namespaces_of_our_own() -> NoReturn:
    """Begin anew where bridges, cables and mounts are not of others, and end with us."""
    again = [sys.executable, "-m", "tests.robustness.chaos", *sys.argv[1:]]
    words = ["unshare", "--mount", "--net", "--propagation", "private", *again]
    os.execvpe(words[0], words, os.environ | {_OF_ITS_OWN: "1"})  # noqa: S606 - our own words


def _play(site: Site, plan: Sequence[Stroke], say: Callable[[str], None]) -> list[Blow]:
    """Strike as planned; gives what fell when, as a stroke may take longer than planned."""
    start = time.monotonic()
    steps = [(stroke.begin, True, stroke) for stroke in plan]
    steps += [(stroke.end, False, stroke) for stroke in plan]
    down: Counter[str] = Counter()
    begun: dict[Stroke, int] = {}
    blows = []
    for instant, begins, stroke in sorted(steps, key=lambda step: step[:2]):
        time.sleep(max(0.0, start + instant - time.monotonic()))
        part, fault = site.part(stroke.part), FAULTS[stroke.fault]
        if begins:
            site.require_alive([part.name for part in site.parts if not down[part.name]])
            say(str(stroke))
            down[stroke.part] += 1
            begun[stroke] = time.time_ns()
            fault.begin(part)
        else:
            fault.end(part)
            down[stroke.part] -= 1
            blows.append(Blow(stroke.fault, stroke.part, begun[stroke], time.time_ns()))
    return blows


def trace_faults(events: Sequence[Event], say: Callable[[str], None]) -> list[str]:
    """What of a trace is no behaviour of the model (`docs/model`)."""
    found = pick(windows(events))
    result = check_windows(found)
    say(
        f"traced: {len(events)} events; {len(found)} windows of {sum(map(len, found))} events "
        f"checked, {result.distinct} states"
    )
    gone = [
        f"{node}: frame {sequence} of boot {boot} was in flash, and is neither stored nor lost"
        for node, boot, sequence in vanished(events)
    ]
    if result.broken is None:
        return gone
    window, at = result.last("window"), result.last("at")
    said = [f"{e.what} {e.gateway} {e.boot}:{e.sequence}" for e in found[window - 1][:at]]
    what = f"{result.broken} after {result.length} states"
    # What came later shows whether something was missing or only late.
    first = found[window - 1][0].time
    later = [
        f"{e.what} {e.gateway} {e.boot}:{e.sequence} at {e.time - first:.4f} s"
        for e in found[window - 1]
    ]
    say(f"the whole window: {', '.join(later)}")
    return [*gone, f"trace of {found[window - 1][0].node}: {what}: {', '.join(said)}"]


def _report(verdict: Verdict, plan: Sequence[Stroke], say: Callable[[str], None]) -> None:
    say(f"faults: {dict(Counter(stroke.fault for stroke in plan))}")
    say(
        f"frames: {verdict.made} made, {verdict.stored} stored, "
        f"{verdict.stated} stated as lost, {verdict.unborn} never in flash"
    )
    say(f"samples within their intervals: {verdict.samples}; gaps: {verdict.gaps}")
    say(f"alarms: {verdict.alarms} raised, {verdict.deliveries} deliveries of their changes")
    if verdict.moves != (0, 0):
        say("shards: {} moves, {} broke off".format(*verdict.moves))
    skipped = "some" if verdict.skipped is None else verdict.skipped
    say(
        f"the skin's viewer got {verdict.seen} frames, and {skipped} were stated as left out; its "
        f"page got {verdict.pages} rounds of answers"
    )
    for fault in verdict.faults:
        say(f"WRONG: {fault}")
    say("FAILED" if verdict.faults else "passed: each frame stored once, each gap explained")


if __name__ == "__main__":
    sys.exit(main())
