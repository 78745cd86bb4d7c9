/** How a UCUM unit is shown: its symbol, and which prefixes it takes. */
export interface Unit {
  readonly symbol: string;
  /** 1 for plain units, 2 for squared ones (a prefix then counts twice), 0 where none is used. */
  readonly power: 0 | 1 | 2;
}

/** A power of ten and its SI symbol. */
export interface Prefix {
  readonly exponent: number;
  readonly symbol: string;
}

const SYMBOLS: Readonly<Record<string, Unit>> = {
  "%": { symbol: "%", power: 0 },
  "1": { symbol: "", power: 0 },
  A: { symbol: "A", power: 1 },
  Cel: { symbol: "°C", power: 0 },
  F: { symbol: "F", power: 1 },
  "F/m": { symbol: "F/m", power: 1 },
  H: { symbol: "H", power: 1 },
  Hz: { symbol: "Hz", power: 1 },
  J: { symbol: "J", power: 1 },
  N: { symbol: "N", power: 1 },
  Ohm: { symbol: "Ω", power: 1 },
  Pa: { symbol: "Pa", power: 1 },
  S: { symbol: "S", power: 1 },
  V: { symbol: "V", power: 1 },
  W: { symbol: "W", power: 1 },
  m: { symbol: "m", power: 1 },
  "m-1": { symbol: "1/m", power: 0 },
  m2: { symbol: "m²", power: 2 },
  s: { symbol: "s", power: 1 },
};

const PREFIXES: readonly string[] = [
  "q", "r", "y", "z", "a", "f", "p", "n", "µ", "m", "", "k", "M", "G", "T", "P", "E", "Z", "Y", "R", "Q",
];
const LARGEST = 30;
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** Finds how a UCUM code is shown; an unknown code is shown as it is, without prefixes. */
export function findUnit(code: string): Unit {
  return SYMBOLS[code] ?? { symbol: code, power: 0 };
}

function powerOfTen(exponent: number): string {
  const digits = [...Math.abs(exponent).toString()].map((digit) => SUPERSCRIPTS[Number(digit)]);
  return `×10${exponent < 0 ? "⁻" : ""}${digits.join("")} `;
}

/** Chooses the prefix for a magnitude whose decimal exponent is given. */
export function choosePrefix(unit: Unit, exponent: number): Prefix {
  if (unit.power === 0) {
    if (exponent >= -4 && exponent < 6) return { exponent: 0, symbol: "" };
    const scale = 3 * Math.floor(exponent / 3);
    return { exponent: scale, symbol: powerOfTen(scale) };
  }
  const step = 3 * unit.power;
  const bounded = Math.max(-LARGEST, Math.min(LARGEST, 3 * Math.floor(exponent / step)));
  return { exponent: bounded * unit.power, symbol: PREFIXES[(bounded + LARGEST) / 3] ?? "" };
}
