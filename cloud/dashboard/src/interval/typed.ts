import { decimalExponent } from "./decimal";
import { choosePrefix, findUnit } from "./unit";

const NUMBER = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;

/** Reads a typed number in multiples of 10^exponent; null where it is none. */
export function parseTyped(text: string, exponent: number): number | null {
  const plain = text.trim().replace(",", ".").replace("−", "-");
  if (!NUMBER.test(plain)) return null;
  const [digits = "", power = "0"] = plain.toLowerCase().split("e");
  const value = Number(`${digits}e${Number(power) + exponent}`);
  return Number.isFinite(value) ? value : null;
}

/** A number cut short: to so many digits in multiples of 10^exponent, and the very number that they name. */
export function shortTyped(value: number, exponent: number, digits: number): { text: string; value: number } {
  const short = Number(value.toPrecision(digits));
  return { text: printTyped(short, exponent), value: short };
}

/** Writes a number with an SI prefix and its unit, so that it reads back as the very same number. */
export function printQuantity(value: number, code: string): string {
  const unit = findUnit(code);
  const prefix = choosePrefix(unit, decimalExponent(value));
  return `${printTyped(value, prefix.exponent)} ${prefix.symbol}${unit.symbol}`.trim();
}

/** Writes a number in multiples of 10^exponent, so that it reads back as the very same number. */
export function printTyped(value: number, exponent: number): string {
  if (value === 0) return "0";
  const [mantissa = "", power = "0"] = Math.abs(value).toExponential().split("e");
  const digits = mantissa.replace(".", "");
  const sign = value < 0 ? "-" : "";
  const point = Number(power) - exponent + 1;
  if (point > 12 || point < -5) return `${sign}${mantissa}e${point - 1}`;
  if (point <= 0) return `${sign}0.${"0".repeat(-point)}${digits}`;
  if (point >= digits.length) return `${sign}${digits.padEnd(point, "0")}`;
  return `${sign}${digits.slice(0, point)}.${digits.slice(point)}`;
}
