import { describe, expect, test } from "vitest";
import { address } from "../src/api/client";
import { LiveEdge } from "../src/live/edge";

function feed(edge: LiveEdge, pace: number): number[] {
  const shown: number[] = [];
  for (let at = 0; at <= 10_000; at += 20) {
    if (at % 500 === 0) edge.observe(at * pace, at);
    const position = edge.at(at, 10e9);
    if (position !== null) shown.push(position);
  }
  return shown;
}

describe("the live edge", () => {
  test("it moves smoothly at the pace of the data, also of a fast one", () => {
    for (const pace of [1e6, 4e6]) {
      const steps = feed(new LiveEdge(), pace).slice(300).map((x, i, all) => (i === 0 ? 20 * pace : x - all[i - 1]!));
      expect(Math.min(...steps)).toBeGreaterThan(0.5 * 20 * pace);
      expect(Math.max(...steps)).toBeLessThan(1.5 * 20 * pace);
    }
  });

  test("it stops when half of the window would be empty", () => {
    const edge = new LiveEdge();
    feed(edge, 1e6);
    expect(edge.at(60_000, 10e9)).toBeLessThanOrEqual(15e9);
    expect(edge.silence(60_000)).toBe(50_000);
  });

  test("older data does not move it back", () => {
    const edge = new LiveEdge();
    edge.observe(5e9, 0);
    edge.observe(1e9, 500);
    expect(edge.newest()).toBe(5e9);
  });
});

describe("addresses", () => {
  test("absent values are left out and others escaped", () => {
    expect(address("/live", { node: null, channel: "n/t 1", points: 50 })).toBe("/api/v1/live?channel=n%2Ft+1&points=50");
  });
});
