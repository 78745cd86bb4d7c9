import type { LagJson } from "../api/contract";
import { type Direction, printUnits, roundToUnits } from "../interval/decimal";

const STEPS: readonly (readonly [string, number, number])[] = [
  ["d", 86_400e9, 0],
  ["h", 3_600e9, 0],
  ["min", 60e9, 0],
];

function nearest(value: number, place: number): bigint {
  return BigInt(Math.round(value / 10 ** place));
}

function round(value: number, place: number, direction: Direction | "nearest"): bigint {
  return direction === "nearest" ? nearest(value, place) : roundToUnits(value, place, direction);
}

/** Prints a duration below two minutes in ns, µs, ms or s to three or four digits. */
function printShort(ns: number, direction: Direction | "nearest"): string {
  const scale = ns >= 1e9 ? 9 : ns >= 1e6 ? 6 : ns >= 1e3 ? 3 : 0;
  const symbol = { 9: "s", 6: "ms", 3: "µs", 0: "ns" }[scale] ?? "ns";
  const place = Math.max(0, scale - (ns >= 100 * 10 ** scale ? 1 : ns >= 10 ** (scale + 1) ? 2 : 3));
  const text = printUnits(round(ns, place, direction), place, scale);
  return `${text.includes(".") ? text.replace(/\.?0+$/, "") : text} ${symbol}`;
}

/** Prints a duration given in nanoseconds; a lower bound asks for "down", an upper bound for "up". */
export function formatDuration(ns: number, direction: Direction | "nearest" = "nearest"): string {
  if (ns <= 0) return "0 s";
  if (ns < 120e9) return printShort(ns, direction);
  for (const [index, [symbol, size]] of STEPS.entries()) {
    if (ns < size) continue;
    const [lower, lowerSize] = STEPS[index + 1] ? [STEPS[index + 1]![0], STEPS[index + 1]![1]] : ["s", 1e9];
    const parts = direction === "up" ? Math.ceil(ns / lowerSize) : Math.floor(ns / lowerSize);
    const per = Math.round(size / lowerSize);
    const rest = parts % per;
    return `${Math.floor(parts / per)} ${symbol}${rest ? ` ${rest} ${lower}` : ""}`;
  }
  return printShort(ns, direction);
}

/** How long after its last sample a frame was stored, rounded outward: `12–15 ms`, `≤ 15 ms`, or `–`. */
export function formatLag(lag: LagJson | null): string {
  if (lag === null) return "–";
  const [least, most] = [formatDuration(lag.lo_ns, "down"), formatDuration(lag.hi_ns, "up")];
  if (lag.lo_ns <= 0) return `≤ ${most}`;
  if (least === most) return least;
  const [low = "", ...unit] = least.split(" ");
  return unit.join(" ") === most.split(" ").slice(1).join(" ") ? `${low}–${most}` : `${least} – ${most}`;
}
