/**
 * Directed rounding of binary doubles to decimals, exact by integer arithmetic: what is printed must
 * enclose what was measured, so a lower bound rounds down and an upper bound rounds up.
 */

export type Direction = "down" | "up";

const MANTISSA_BITS = 52n;
const EXPONENT_BIAS = 1075;

/** Splits a finite double into the integers of value = mantissa × 2^exponent. */
function splitDouble(value: number): { mantissa: bigint; exponent: number } {
  const view = new DataView(new ArrayBuffer(8));
  view.setFloat64(0, value);
  const bits = view.getBigUint64(0);
  const biased = Number((bits >> MANTISSA_BITS) & 0x7ffn);
  const fraction = bits & ((1n << MANTISSA_BITS) - 1n);
  const magnitude = biased === 0 ? fraction : fraction | (1n << MANTISSA_BITS);
  const exponent = (biased === 0 ? 1 : biased) - EXPONENT_BIAS;
  return { mantissa: value < 0 ? -magnitude : magnitude, exponent };
}

/** Floor of numerator / denominator for a positive denominator. */
function floorDivide(numerator: bigint, denominator: bigint): bigint {
  const quotient = numerator / denominator;
  return numerator % denominator < 0n ? quotient - 1n : quotient;
}

/**
 * Rounds a finite double to a whole number of 10^exponent in the given direction.
 *
 * A decimal that reads back as the very same double is that double's name and is kept: 0.1 rounds to
 * 0.1 both ways, although its binary value lies a little above.
 */
export function roundToUnits(value: number, exponent: number, direction: Direction): bigint {
  const { mantissa, exponent: binary } = splitDouble(value);
  let numerator = mantissa;
  let denominator = 1n;
  if (binary >= 0) numerator <<= BigInt(binary);
  else denominator <<= BigInt(-binary);
  if (exponent >= 0) denominator *= 10n ** BigInt(exponent);
  else numerator *= 10n ** BigInt(-exponent);
  const down = floorDivide(numerator, denominator);
  const up = -floorDivide(-numerator, denominator);
  for (const units of [down, up]) {
    if (Number(`${units}e${exponent}`) === value) return units;
  }
  return direction === "down" ? down : up;
}

/** Writes units × 10^exponent in multiples of 10^scale, for scale ≥ exponent, with a true minus sign. */
export function printUnits(units: bigint, exponent: number, scale: number): string {
  const decimals = scale - exponent;
  const sign = units < 0n ? "−" : "";
  const digits = (units < 0n ? -units : units).toString().padStart(decimals + 1, "0");
  if (decimals === 0) return sign + digits;
  return `${sign}${digits.slice(0, -decimals)}.${digits.slice(-decimals)}`;
}

/** The decimal exponent of a magnitude: floor(log10 |value|), exact at powers of ten. */
export function decimalExponent(value: number): number {
  return Number(Math.abs(value).toExponential().split("e")[1]);
}
