import { describe, expect, test } from "vitest";
import { formatDuration } from "../src/time/duration";
import { decimalsFor, parseInstant, printInstant } from "../src/time/instant";
import { tickLabel, tickPositions, tickStep } from "../src/time/ticks";
import { Timeline } from "../src/time/timeline";

describe("instants", () => {
  test("nanoseconds survive reading and printing", () => {
    for (const text of ["2026-01-31T12:00:00.123456789Z", "1969-12-31T23:59:59.999999999Z", "2026-02-28T23:59:59.000000001Z"]) {
      expect(printInstant(parseInstant(text))).toBe(text);
    }
  });

  test("offsets and short fractions are understood", () => {
    expect(parseInstant("2026-01-31T12:00:00.5+01:00")).toBe(parseInstant("2026-01-31T11:00:00.500Z"));
  });

  test("what is no time is refused with the text and an example", () => {
    expect(() => parseInstant("yesterday")).toThrow(/yesterday.*RFC 3339/);
    expect(() => parseInstant("2026-13-41T12:00:00Z")).toThrow(RangeError);
  });

  test("a timeline keeps every nanosecond for months", () => {
    const origin = parseInstant("2026-01-31T12:00:00Z");
    const timeline = new Timeline(origin);
    const later = origin + 100n * 86_400_000_000_000n + 1n;
    expect(timeline.toInstant(timeline.toX(later))).toBe(later);
  });

  test("shorter spans need more decimals", () => {
    expect([5e9, 1e8, 1e5, 10].map(decimalsFor)).toEqual([0, 3, 6, 9]);
  });
});

describe("durations", () => {
  test("the unit fits the size", () => {
    expect([10e9, 35.129e6, 2.5e3, 40, 200e9, 3600e9, 93_600e9].map((ns) => formatDuration(ns))).toEqual([
      "10 s", "35.13 ms", "2.5 µs", "40 ns", "3 min 20 s", "1 h", "1 d 2 h",
    ]);
  });

  test("bounds round outward", () => {
    expect(formatDuration(1_234_567_890, "down")).toBe("1.234 s");
    expect(formatDuration(1_234_567_890, "up")).toBe("1.235 s");
    expect(formatDuration(200_500_000_000, "up")).toBe("3 min 21 s");
  });

  test("nothing is 0 s", () => {
    expect(formatDuration(0)).toBe("0 s");
  });
});

describe("ticks", () => {
  test("steps are round", () => {
    expect([3e6, 1.2e9, 7e9, 40e9, 5000e9, 100_000e9].map(tickStep)).toEqual([5e6, 2e9, 10e9, 60e9, 7200e9, 172_800e9]);
  });

  test("ticks lie on whole steps inside the window", () => {
    const timeline = new Timeline(parseInstant("2026-01-31T12:00:00.7Z"));
    const ticks = tickPositions(timeline, 0, 5e9, 1e9);
    expect(ticks).toEqual([3e8, 1.3e9, 2.3e9, 3.3e9, 4.3e9]);
  });

  test("a label shows what the step changes", () => {
    const timeline = new Timeline(parseInstant("2026-01-31T12:34:56.789Z"));
    expect(tickLabel(timeline, 0, 1e6)).toBe("56.789");
    expect(tickLabel(timeline, 0, 1e9)).toMatch(/^\d\d:34:56$/);
    expect(tickLabel(timeline, 0, 60e9)).toMatch(/^\d\d:34$/);
  });
});
