import { decimalExponent, printUnits, roundToUnits } from "./decimal";
import { isMissing, type Interval } from "./interval";
import { choosePrefix, findUnit, type Prefix } from "./unit";

/** Digits for a bound that stands alone, and for a value of no width. */
const LONE_DIGITS = 5;
/** A bound is never printed to more digits than a double holds. */
const MOST_DIGITS = 15;

function largest(interval: Interval): number {
  const sides = [interval.lo, interval.hi].filter(Number.isFinite).map(Math.abs);
  return sides.length === 0 ? 0 : Math.max(...sides);
}

/** The last decimal place to print: fine enough to keep the interval's width, never finer than useful. */
function lastPlace(interval: Interval, prefix: Prefix): number {
  const top = decimalExponent(largest(interval));
  const width = interval.hi - interval.lo;
  if (!Number.isFinite(width) || width === 0) return Math.min(top - LONE_DIGITS + 1, prefix.exponent);
  const place = decimalExponent(width);
  const fine = width / 10 ** place < 3 ? place - 1 : place;
  return Math.min(Math.max(fine, top - MOST_DIGITS + 1), top - 2, prefix.exponent);
}

function withUnit(text: string, prefix: Prefix, symbol: string): string {
  const unit = `${prefix.symbol}${symbol}`;
  return unit === "" ? text : `${text} ${unit}`;
}

/**
 * Prints an interval with an SI prefix, rounded outward: what is printed encloses what is given.
 *
 * @param interval the bounds, in the unit itself
 * @param code the UCUM code of the unit
 * @returns such as `12.31–12.36 pF`, `≥ 12.3 pF`, `unbounded` or `missing`
 */
export function formatInterval(interval: Interval, code: string): string {
  if (isMissing(interval)) return "missing";
  const { lo, hi } = interval;
  if (lo === -Infinity && hi === Infinity) return "unbounded";
  const unit = findUnit(code);
  const magnitude = largest(interval);
  if (magnitude === 0) return withUnit(printZero(interval), { exponent: 0, symbol: "" }, unit.symbol);
  const prefix = choosePrefix(unit, decimalExponent(magnitude));
  const place = lastPlace(interval, prefix);
  const print = (value: number, direction: "down" | "up"): string =>
    printUnits(roundToUnits(value, place, direction), place, prefix.exponent);
  if (lo === -Infinity) return withUnit(`≤ ${print(hi, "up")}`, prefix, unit.symbol);
  if (hi === Infinity) return withUnit(`≥ ${print(lo, "down")}`, prefix, unit.symbol);
  const low = print(lo, "down");
  const high = print(hi, "up");
  const dash = lo < 0 ? " … " : "–";
  return withUnit(low === high ? low : `${low}${dash}${high}`, prefix, unit.symbol);
}

function printZero(interval: Interval): string {
  if (interval.lo === -Infinity) return "≤ 0";
  return interval.hi === Infinity ? "≥ 0" : "0";
}

/** Prints a count as `1`, `0–3` or `≥ 2`. */
export function formatCount(count: Interval): string {
  if (isMissing(count)) return "missing";
  const lo = Math.max(0, Math.floor(count.lo));
  if (count.hi === Infinity) return `≥ ${lo}`;
  const hi = Math.ceil(count.hi);
  return lo === hi ? `${lo}` : `${lo}–${hi}`;
}

/**
 * Prints a coverage as a percentage, rounded down to the place of its complement's first digit.
 *
 * @returns such as `≥ 99.9999998 %`, or `100 %` for bounded noise
 */
export function formatCoverage(coverage: number): string {
  if (coverage >= 1) return "100 %";
  if (!(coverage > 0)) return "≥ 0 %";
  const place = Math.min(decimalExponent(1 - coverage), -2);
  const kept = printUnits(roundToUnits(coverage, place, "down"), place, -2);
  return `≥ ${kept.replace(/\.0+$/, "")} %`;
}

/** Prints axis ticks with one common prefix; ticks are labels of the scale, not measurements. */
export function formatTicks(ticks: readonly number[], code: string): { labels: string[]; unit: string } {
  const unit = findUnit(code);
  const top = Math.max(0, ...ticks.map(Math.abs));
  if (top === 0) return { labels: ticks.map(() => "0"), unit: unit.symbol };
  const prefix = choosePrefix(unit, decimalExponent(top));
  const step = ticks.length > 1 ? Math.abs((ticks[1] ?? 0) - (ticks[0] ?? 0)) : top;
  const place = step > 0 ? decimalExponent(step * 1.0001) : prefix.exponent;
  const half = /^[1-9]\.5/.test(step.toExponential(3)) ? 1 : 0;
  const decimals = Math.max(0, Math.min(MOST_DIGITS, prefix.exponent - place + half));
  const labels = ticks.map((tick) => {
    const text = (tick / 10 ** prefix.exponent).toFixed(decimals);
    return Number(text) === 0 ? "0" : text.replace("-", "−");
  });
  return { labels, unit: `${prefix.symbol}${unit.symbol}`.trim() };
}
