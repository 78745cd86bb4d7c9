import type { TotalsAnswer } from "../api/contract";
import { decimalExponent, roundToUnits } from "../interval/decimal";
import { formatCount } from "../interval/format";
import type { View } from "../state/route";
import type { Range } from "../state/window";
import { formatDuration } from "../time/duration";
import { element } from "./element";

const LIVE_PAUSE_MS = 2_000;
const SETTLE_MS = 200;
/** An answer that takes longer is given up. */
const PATIENCE_MS = 30_000;

/**
 * Decides when to send a query: once the window has settled, and every two seconds while it moves. It waits for the
 * answer first, or a slow cloud would never answer one.
 */
export class RequestTimer {
  private askedAt = 0;
  private waiting = false;
  private due: number | null = null;

  /** Call when the window or the question has changed: the query is due once it settles. */
  settle(): void {
    this.due = performance.now() + SETTLE_MS;
  }

  /** Stops; nothing is due. */
  stop(): void {
    this.due = null;
  }

  isDue(at: number, view: View): boolean {
    const live = view.kind === "live" && at - this.askedAt > (this.waiting ? PATIENCE_MS : LIVE_PAUSE_MS);
    return live || (this.due !== null && at >= this.due);
  }

  /** Call when the query is sent. */
  ask(at: number): void {
    this.due = null;
    this.askedAt = at;
    this.waiting = true;
  }

  /** Call when the query is answered or aborted. */
  answered(): void {
    this.waiting = false;
  }
}

const SECOND = 1e9;

/** How an answer is put in words. */
export interface Wording {
  /** Which state it is about, such as "above 5 pF". */
  readonly state: string;
  /** The answer, in bold and after it, where no sample may be in that state. */
  readonly never: string;
  readonly because: (window: string) => string;
  /** How the sums are called for tests: `total-certain`, … */
  readonly name: string;
}

/** In ns: certain time, possible time at most, and unknown time. */
export interface Sums {
  readonly certain: number;
  readonly atMost: number;
  readonly unknown: number;
}

/** Seconds, of whole nanoseconds, in nanoseconds. */
function nanoseconds(seconds: number): number {
  return Math.round(seconds * SECOND);
}

/** The cloud's sums in ns; null where nothing is known of the whole window. */
export function readSums({ time_s, unknown_s }: Pick<TotalsAnswer, "time_s" | "unknown_s">, { x0, x1 }: Range): Sums | null {
  const unknown = nanoseconds(unknown_s);
  // A window's ends are asked for in whole nanoseconds.
  if (unknown >= x1 - x0 - 1) return null;
  return { certain: nanoseconds(time_s.lo ?? 0), atMost: time_s.hi === null ? x1 - x0 : nanoseconds(time_s.hi), unknown };
}

/** An answer in words: certain, possible and unknown time. */
export function totalsAnswer(
  found: TotalsAnswer,
  range: Range,
  { wording, complete }: { wording: Wording; complete: boolean },
): readonly (HTMLElement | string)[] {
  const sums = readSums(found, range);
  if (sums === null) return ["Nothing is known in this window, so there is no answer."];
  const { certain, atMost, unknown } = sums;
  const window = formatDuration(range.x1 - range.x0);
  const rest = unknown > 0 ? `, unknown for ${formatDuration(unknown, "up")}` : "";
  const silent = element("strong", { "data-testid": `${wording.name}-unknown`, "data-ns": unknown }, rest);
  if (atMost === 0 && found.entries.hi === 0) return [element("strong", {}, wording.never), `: ${wording.because(window)}`, silent, "."];
  const times = formatCount(found.entries);
  return [
    `${wording.state}: `,
    element("strong", { "data-testid": `${wording.name}-certain`, "data-ns": certain }, `certainly ${formatDuration(certain, "down")}`),
    ", ",
    element("strong", { "data-testid": `${wording.name}-possible`, "data-ns": atMost }, `possibly up to ${formatDuration(atMost, "up")}`),
    silent,
    `, of ${window}; it began ${times} ${times === "1" ? "time" : "times"}.`,
    complete ? "" : element("span", { class: "warn" }, " Too many segments to show all: zoom in."),
  ];
}

/** How many verdicts a year are false, as an expected number at most, which is rounded up. */
export function falseVerdicts(perYear: number): string {
  if (perYear === 0) return "False verdicts expected a year: none, as all errors are bounded.";
  const place = decimalExponent(perYear) - 1;
  const most = Number(`${roundToUnits(perYear, place, "up")}e${place}`);
  const text = most.toLocaleString("en", { maximumSignificantDigits: 2 });
  return `False verdicts expected a year: at most ${text}, with one verdict at each sample.`;
}
