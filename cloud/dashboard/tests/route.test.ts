import { describe, expect, test } from "vitest";
import { type Route, printRoute, parseRoute } from "../src/state/route";
import { cut, pan, SHORTEST, zoom } from "../src/state/window";

describe("the address", () => {
  const history = { kind: "history", from: 1_795_229_398_957_813_411n, to: 1_795_229_398_992_939_801n } as const;

  test("every place survives writing and reading", () => {
    const places: Route[] = [
      { node: null, channel: null, view: { kind: "live", span: 10e9 }, question: null },
      { node: "fingertip", channel: null, view: { kind: "live", span: 300e9 }, question: null },
      { node: "n/1 %ü", channel: "t01.capacitance", view: history, question: { kind: "threshold", side: "above", level: 1.24e-11 } },
      { node: "n", channel: "c", view: history, question: { kind: "threshold", side: "below", level: -0.5 } },
      { node: "n", channel: "c", view: history, question: { kind: "formula", formula: "once[0,20ms] c + 1 > 5e-12 F and \"m/c\" < 50 %" } },
      {
        node: "palm",
        channel: "t01.capacitance",
        view: history,
        question: {
          kind: "model",
          model: "touch.capacitance",
          origin: 1_795_229_398_000_000_001n,
          parameters: [{ name: "minimum_area", lo: 0.9e-5, hi: 1.1e-5 }, { name: "voltage", lo: -1e21, hi: 1e21 }],
        },
      },
    ];
    for (const place of places) expect(parseRoute(printRoute(place))).toEqual(place);
  });

  test("what cannot be read falls back to live", () => {
    for (const hash of ["", "#", "#/n?from=x&to=y", "#/n?live=7s", "#/n?from=2026-01-02T00:00:00Z&to=2026-01-01T00:00:00Z"]) {
      expect(parseRoute(hash).view).toEqual({ kind: "live", span: 10e9 });
    }
    expect(parseRoute("#/%zz").node).toBe("%zz");
    expect(parseRoute("#/n/c?above=much").question).toBeNull();
    expect(parseRoute("#/n/c?model=constant&origin=noon&parameter=value:1").question).toBeNull();
    const question = parseRoute("#/n/c?model=constant&origin=2026-01-01T00:00:00Z&parameter=value:2&parameter=x:&parameter=:1&parameter=y:a:1").question;
    expect(question).toMatchObject({ kind: "model", parameters: [{ name: "value", lo: 2, hi: 2 }] });
  });
});

describe("windows", () => {
  test("zooming keeps the anchor in its place", () => {
    const next = zoom({ x0: 0, x1: 1000 }, 0.25, 0.5);
    expect(next).toEqual({ x0: 125, x1: 625 });
  });

  test("zooming stops at the shortest window", () => {
    const next = zoom({ x0: 0, x1: 120 }, 0.5, 0.01);
    expect(next.x1 - next.x0).toBeGreaterThanOrEqual(SHORTEST);
  });

  test("panning keeps the length", () => {
    expect(pan({ x0: 0, x1: 1000 }, -0.1)).toEqual({ x0: -100, x1: 900 });
  });

  test("a selection may be drawn from either side", () => {
    expect(cut({ x0: 0, x1: 1000 }, 0.7, 0.2)).toEqual({ x0: 200, x1: 700 });
  });
});
