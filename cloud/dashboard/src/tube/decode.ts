import type { SeriesAnswer } from "../api/contract";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { HULL_REACH, SAMPLE_REACH, type Entries } from "./entries";

/** Reads the cloud's series: null on one side is unbounded, on both sides missing. */
export function readSeries(answer: SeriesAnswer, timeline: Timeline): Entries {
  const count = answer.t.length;
  const start = timeline.toX(parseInstant(answer.t0));
  const t = Float64Array.from(answer.t, (offset) => start + offset);
  const lo = new Float64Array(count);
  const hi = new Float64Array(count);
  for (let i = 0; i < count; i += 1) {
    const low = answer.lo[i] ?? null;
    const high = answer.hi[i] ?? null;
    const missing = low === null && high === null;
    lo[i] = missing ? Number.NaN : (low ?? -Infinity);
    hi[i] = missing ? Number.NaN : (high ?? Infinity);
  }
  const hull = answer.resolution === "hull";
  const width = new Float64Array(count).fill(hull ? answer.dt : 0);
  const doubt = new Float64Array(count).fill(1 - answer.coverage);
  // Far from the timeline's origin, the numbers that times are painted by leave nanoseconds out.
  const slip = timeline.slip(Math.max(Math.abs(start), Math.abs(t.at(-1) ?? start)));
  const error = new Float64Array(count).fill(answer.time_error + slip);
  const reach = new Float64Array(count).fill((hull ? HULL_REACH : SAMPLE_REACH) * answer.dt);
  return { t, width, lo, hi, doubt, error, reach };
}
