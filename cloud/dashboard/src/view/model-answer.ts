import type { OccupancyAnswer } from "../api/contract";
import { formatCount } from "../interval/format";
import type { Range } from "../state/window";
import { formatDuration } from "../time/duration";
import { element } from "./element";

const SECOND = 1e9;

/** Seconds, of whole nanoseconds, in nanoseconds. */
function nanoseconds(seconds: number): number {
  return Math.round(seconds * SECOND);
}

/** Says for how long a channel was not as predicted: certainly, possibly at most, and how long nobody knows. */
export function modelAnswer(found: OccupancyAnswer, range: Range, complete: boolean): readonly (HTMLElement | string)[] {
  const [certain, atMost, unknown] = [found.time_s.lo, found.time_s.hi, found.unknown_s].map(nanoseconds) as [number, number, number];
  const window = formatDuration(range.x1 - range.x0);
  const nothing = unknown >= range.x1 - range.x0 - 1;
  if (nothing) return ["Nothing is known in this window, so there is no answer."];
  const rest = unknown > 0 ? `, unknown for ${formatDuration(unknown, "up")}` : "";
  const silent = element("strong", { "data-testid": "anomalous-unknown", "data-ns": unknown }, rest);
  if (found.samples.hi === 0) {
    return [element("strong", {}, "No anomaly"), `: all that is known in this window of ${window} is as predicted`, silent, "."];
  }
  const times = formatCount(found.entries);
  return [
    "Not as predicted: ",
    element("strong", { "data-testid": "anomalous-certain", "data-ns": certain }, `certainly ${formatDuration(certain, "down")}`),
    ", ",
    element("strong", { "data-testid": "anomalous-possible", "data-ns": atMost }, `possibly up to ${formatDuration(atMost, "up")}`),
    silent,
    `, of ${window}; it began ${times} ${times === "1" ? "time" : "times"}.`,
    complete ? "" : element("span", { class: "warn" }, " Too many segments to show all: zoom in."),
  ];
}
