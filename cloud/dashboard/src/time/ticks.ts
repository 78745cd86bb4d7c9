import { decimalsFor, printClock, printDay } from "./instant";
import type { Timeline } from "./timeline";

const DAY = 86_400e9;
const CLOCK_STEPS: readonly number[] = [
  1e9, 2e9, 5e9, 10e9, 15e9, 30e9, 60e9, 120e9, 300e9, 600e9, 900e9, 1800e9,
  3600e9, 7200e9, 10_800e9, 21_600e9, 43_200e9, DAY,
];

/** The smallest round step of time (in ns) that is at least `least`. */
export function tickStep(least: number): number {
  if (least <= 1e9) {
    const power = 10 ** Math.max(0, Math.floor(Math.log10(Math.max(least, 1))));
    for (const factor of [1, 2, 5, 10]) if (power * factor >= least) return power * factor;
  }
  for (const step of CLOCK_STEPS) if (step >= least) return step;
  const days = least / DAY;
  const power = 10 ** Math.floor(Math.log10(days));
  for (const factor of [1, 2, 5]) if (power * factor >= days) return power * factor * DAY;
  return power * 10 * DAY;
}

/** The positions (ns after the origin) of round local times inside a window. */
export function tickPositions(timeline: Timeline, min: number, max: number, step: number): number[] {
  const zone = new Date(Number(timeline.toInstant(min) / 1_000_000n)).getTimezoneOffset() * 60e9;
  const shift = BigInt(step >= 3600e9 ? zone : 0);
  const size = BigInt(Math.round(step));
  const first = timeline.toInstant(min) - shift;
  const aligned = first - (((first % size) + size) % size) + shift;
  const ticks: number[] = [];
  for (let x = timeline.toX(aligned); x <= max; x += step) if (x >= min) ticks.push(x);
  return ticks;
}

/** The label of a tick: only the part of the time that the step can change, and the day at midnight. */
export function tickLabel(timeline: Timeline, x: number, step: number): string {
  const instant = timeline.toInstant(x);
  const clock = printClock(instant, step >= 1e9 ? 0 : decimalsFor(step));
  if (step >= DAY || clock === "00:00:00") return printDay(instant);
  return step >= 60e9 ? clock.slice(0, 5) : step < 1e9 ? clock.slice(6) : clock;
}
