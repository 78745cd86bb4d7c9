import type { EventItem, Verdict } from "../api/contract";
import { readInterval, type Interval } from "../interval/interval";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";

/** A peak as a region of the plot: when and how high it is, as intervals; or several that lie too close. */
export interface PeakMark {
  readonly event: EventItem;
  readonly verdict: Verdict;
  readonly x0: number;
  readonly x1: number;
  readonly lo: number;
  readonly hi: number;
  /** How many peaks it stands for. */
  readonly count: Interval;
  /** How many events it stands for: 1, or more for a group. */
  readonly events: number;
}

/** Reads a peak of the event list; null for other events. */
export function readPeak(event: EventItem, timeline: Timeline): PeakMark | null {
  if (event.kind !== "peak" || event.verdict === null) return null;
  const height = event.height ? readInterval(event.height) : { lo: -Infinity, hi: Infinity };
  const usual = { lo: event.verdict === "certain" ? 1 : 0, hi: 1 };
  return {
    event,
    verdict: event.verdict,
    x0: timeline.toX(parseInstant(event.time.lo)),
    x1: timeline.toX(parseInstant(event.time.hi)),
    ...height,
    count: event.count ? readInterval(event.count) : usual,
    events: 1,
  };
}

function join(one: PeakMark, other: PeakMark): PeakMark {
  return {
    event: one.event,
    verdict: one.verdict === "certain" || other.verdict === "certain" ? "certain" : "possible",
    x0: Math.min(one.x0, other.x0),
    x1: Math.max(one.x1, other.x1),
    lo: Math.min(one.lo, other.lo),
    hi: Math.max(one.hi, other.hi),
    count: { lo: one.count.lo + other.count.lo, hi: one.count.hi + other.count.hi },
    events: one.events + other.events,
  };
}

/**
 * Joins peaks that begin within `reach` ns of a group's first. Counts add as intervals: a certain peak
 * and one that is possible up to three times are 1–4 peaks, of which at least one is certain.
 *
 * @param marks in the order of time
 */
export function groupPeaks(marks: readonly PeakMark[], reach: number): PeakMark[] {
  const groups: PeakMark[] = [];
  for (const mark of marks) {
    const last = groups.at(-1);
    if (last && mark.x0 - last.x0 < reach) groups[groups.length - 1] = join(last, mark);
    else groups.push(mark);
  }
  return groups;
}
