import { describe, expect, test } from "vitest";
import { Client } from "../src/api/client";
import type { TotalsAnswer } from "../src/api/contract";
import { falseVerdicts, readSums } from "../src/view/question-parts";

const WINDOW = { x0: -1e6, x1: 2e7 };
const NONE = { lo: 0, hi: 0 };

function answer(lo: number, hi: number, unknown: number): TotalsAnswer {
  return { start: "", end: "", time_s: { lo, hi }, unknown_s: unknown, entries: NONE, coverage: 1 };
}

describe("how long a threshold was passed", () => {
  test("is asked for in the window", async () => {
    const asked: string[] = [];
    const fetch = (url: RequestInfo | URL): Promise<Response> => {
      asked.push(String(url));
      return Promise.resolve(Response.json(answer(0.002, 0.003, 0.018)));
    };
    const client = new Client({ fetch, onUnauthorised: () => undefined });
    const place = { node: "n", channel: "t01.capacitance" };
    const found = await client.thresholdTime(place, { above: 5e-12, start: 1n, end: 9n }, new AbortController().signal);
    expect(asked).toEqual(["/api/v1/series/n/t01.capacitance/time?above=5e-12&start=1&end=9"]);
    expect(readSums(found, WINDOW)).toEqual({ certain: 2e6, atMost: 3e6, unknown: 18e6 });
  });

  test("has no answer where nothing is known", () => {
    expect(readSums(answer(0, 0, 0.021), WINDOW)).toBeNull();
    expect(readSums(answer(0, 0, 0.020), WINDOW)).toEqual({ certain: 0, atMost: 0, unknown: 20e6 });
  });
});

/** The number that is said of false verdicts. */
function said(perYear: number): string {
  return /at most ([^ ]*), with one verdict at each sample/.exec(falseVerdicts(perYear))![1]!;
}

describe("false verdicts", () => {
  test("are none where all errors are bounded", () => {
    expect(falseVerdicts(0)).toBe("False verdicts expected a year: none, as all errors are bounded.");
  });

  test("are rounded up, however few or many", () => {
    expect(said(2_801)).toBe("2,900");
    expect(said(0.003_41)).toBe("0.0035");
    expect(said(3.2e9)).toBe("3,200,000,000");
    for (let exponent = -9; exponent < 12; exponent += 1) {
      for (const digits of [1, 1.2345, 9.91, 9.999]) {
        const value = digits * 10 ** exponent;
        expect(Number(said(value).replaceAll(",", ""))).toBeGreaterThanOrEqual(value);
        expect(Number(said(value).replaceAll(",", ""))).toBeLessThanOrEqual(value * 1.101);
      }
    }
  });
});
