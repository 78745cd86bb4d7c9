import { describe, expect, test } from "vitest";
import { printUnits, roundToUnits } from "../src/interval/decimal";
import { formatCount, formatCoverage, formatInterval, formatTicks } from "../src/interval/format";

/** A small generator with a fixed seed, so that a failure can be repeated. */
function* numbers(seed: number): Generator<number> {
  for (let state = seed; ; ) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    yield state / 2 ** 32;
  }
}

function readBack(text: string, prefix: string): number {
  const exponents: Record<string, number> = { f: -15, p: -12, n: -9, µ: -6, m: -3, "": 0, k: 3, M: 6 };
  return Number(`${text.replace("−", "-")}e${exponents[prefix]}`);
}

describe("directed rounding", () => {
  test("a lower bound rounds down and an upper bound up", () => {
    expect(roundToUnits(12.3112, -2, "down")).toBe(1231n);
    expect(roundToUnits(12.3112, -2, "up")).toBe(1232n);
    expect(roundToUnits(-12.3112, -2, "down")).toBe(-1232n);
    expect(roundToUnits(-12.3112, -2, "up")).toBe(-1231n);
  });

  test("a decimal that names the double is kept both ways", () => {
    expect(roundToUnits(0.1, -1, "up")).toBe(1n);
    expect(roundToUnits(0.1, -1, "down")).toBe(1n);
    expect(roundToUnits(12.3e-12, -13, "up")).toBe(123n);
  });

  test("tiny and huge doubles round exactly", () => {
    expect(roundToUnits(5e-324, 0, "up")).toBe(1n);
    expect(roundToUnits(5e-324, 0, "down")).toBe(0n);
    expect(roundToUnits(2 ** 80, 24, "down")).toBe(1n);
  });

  test("units are printed with their decimals", () => {
    expect(printUnits(-5n, -3, 0)).toBe("−0.005");
    expect(printUnits(1231n, -14, -12)).toBe("12.31");
  });
});

describe("intervals", () => {
  test("the width chooses the digits", () => {
    expect(formatInterval({ lo: 12.3112e-12, hi: 12.3587e-12 }, "F")).toBe("12.31–12.36 pF");
    expect(formatInterval({ lo: 1.19793e6, hi: 1.19926e6 }, "Hz")).toBe("1.1979–1.1993 MHz");
  });

  test("what is printed encloses what was given", () => {
    const random = numbers(7);
    const next = (): number => random.next().value as number;
    for (let round = 0; round < 3000; round += 1) {
      const lo = (next() - 0.3) * 10 ** (-11 + 14 * next());
      const hi = lo + Math.abs(lo) * next() ** 4;
      const text = formatInterval({ lo, hi }, "V");
      const match = /^(−?[\d.]+)(?:(?:–| … )(−?[\d.]+))? (.?)V$/.exec(text);
      expect(match, text).not.toBeNull();
      expect(readBack(match![1]!, match![3]!), text).toBeLessThanOrEqual(lo);
      expect(readBack(match![2] ?? match![1]!, match![3]!), text).toBeGreaterThanOrEqual(hi);
    }
  });

  test("unbounded sides and missing values are said", () => {
    expect(formatInterval({ lo: 12.3e-12, hi: Infinity }, "F")).toBe("≥ 12.300 pF");
    expect(formatInterval({ lo: -Infinity, hi: -2 }, "V")).toBe("≤ −2.0000 V");
    expect(formatInterval({ lo: -Infinity, hi: Infinity }, "V")).toBe("unbounded");
    expect(formatInterval({ lo: Number.NaN, hi: Number.NaN }, "V")).toBe("missing");
  });

  test("a negative lower bound is set apart from the dash", () => {
    expect(formatInterval({ lo: -0.31, hi: 0.12 }, "V")).toBe("−310 … 120 mV");
  });

  test("squared units take squared prefixes, and other units none", () => {
    expect(formatInterval({ lo: 12e-6, hi: 13e-6 }, "m2")).toBe("12.0–13.0 mm²");
    expect(formatInterval({ lo: 21.4, hi: 21.9 }, "Cel")).toBe("21.4–21.9 °C");
    expect(formatInterval({ lo: 3e-8, hi: 4e-8 }, "[arb'U]")).toBe("30.0–40.0 ×10⁻⁹ [arb'U]");
  });

  test("zero needs no prefix", () => {
    expect(formatInterval({ lo: 0, hi: 0 }, "A")).toBe("0 A");
    expect(formatInterval({ lo: 0, hi: 2e-3 }, "A")).toBe("0.00–2.00 mA");
  });
});

describe("coverage", () => {
  test("it is never rounded up", () => {
    expect(formatCoverage(0.999999998026825)).toBe("≥ 99.9999998 %");
    expect(formatCoverage(0.9973)).toBe("≥ 99.7 %");
    expect(formatCoverage(0.99)).toBe("≥ 99 %");
    expect(formatCoverage(1 - 2 ** -53)).toMatch(/^≥ 99\.9+\d? %$/);
  });

  test("only a coverage of one is 100 %", () => {
    expect(formatCoverage(1)).toBe("100 %");
    expect(formatCoverage(0.9999999999999999)).not.toContain("100");
  });

  test("the printed share is at most the given one", () => {
    const random = numbers(3);
    for (let round = 0; round < 2000; round += 1) {
      const coverage = 1 - 10 ** (-14 * (random.next().value as number));
      const printed = Number(/[\d.]+/.exec(formatCoverage(coverage))![0]) / 100;
      expect(printed).toBeLessThanOrEqual(coverage + 1e-16);
    }
  });
});

describe("counts and ticks", () => {
  test("a count is one number, a span or at least", () => {
    expect(formatCount({ lo: 1, hi: 1 })).toBe("1");
    expect(formatCount({ lo: 0, hi: 3 })).toBe("0–3");
    expect(formatCount({ lo: 2, hi: Infinity })).toBe("≥ 2");
  });

  test("ticks share one prefix and enough decimals to differ", () => {
    expect(formatTicks([12.2e-12, 12.25e-12, 12.3e-12], "F")).toEqual({ labels: ["12.20", "12.25", "12.30"], unit: "pF" });
    expect(formatTicks([0, 0.5, 1], "V").labels).toEqual(["0", "0.5", "1.0"]);
    expect(new Set(formatTicks([0, 2.5e-3, 5e-3, 7.5e-3], "V").labels).size).toBe(4);
  });
});
