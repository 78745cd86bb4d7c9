import { describe, expect, it } from "vitest";
import type { GestureItem } from "../src/api/contract";
import { askedLive, askedOf, GestureLog, type GestureMark, kindText, labelText, marksOf, placeOfLabel } from "../src/skin/gestures";
import { parseInstant, printInstant } from "../src/time/instant";
import { Timeline } from "../src/time/timeline";

const ORIGIN = parseInstant("2026-01-31T12:00:00Z");
const timeline = new Timeline(ORIGIN);
const WINDOW = { x0: 0, x1: 3e9 };

function instant(x: number | null): string | null {
  return x === null ? null : printInstant(ORIGIN + BigInt(x));
}

/** A gesture, of which each instant is known to 1 ms. */
function gesture(kind: GestureItem["kind"], begin: number | null, end: number | null, more: Partial<GestureItem> = {}): GestureItem {
  return {
    kind,
    verdict: "certain",
    contacts: [0],
    begin: { lo: instant(begin), hi: instant((begin ?? 0) + 1e6) },
    end: { lo: instant((end ?? 3e9) - 1e6), hi: instant(end) },
    direction: null,
    angle: null,
    scale: null,
    places: [{ begin: [[0, 2], [1, 1]], end: [[4, 6], [1, 1]] }],
    ...more,
  };
}

function stray(begin: number, contacts: number[] = []): GestureItem {
  return gesture("tap", begin, begin + 5e7, { verdict: "possible", contacts });
}

function marks(...items: GestureItem[]): GestureMark[] {
  return marksOf(items, WINDOW, timeline);
}

function texts(found: readonly GestureMark[]): string[] {
  return found.map((mark) => `${mark.verdict} ${kindText(mark)}`);
}

describe("marks of gestures", () => {
  it("stand in the middles of what encloses their places", () => {
    const [mark] = marks(gesture("swipe", 1e9, 1.2e9));
    expect(mark?.ways).toEqual([{ begin: [1, 1], end: [5, 1] }]);
    expect(placeOfLabel(mark!)).toEqual([5, 1]);
    expect([mark!.begin, mark!.end]).toEqual([1e9, 1.2e9]);
  });

  it("have no place where a bound is missing", () => {
    const unknown = { begin: [[null, null], [null, null]] as [null, null][], end: [[1, 3], [0, 2]] as [number, number][] };
    const [mark] = marks(gesture("tap", null, 1e9, { verdict: "possible", places: [unknown] }));
    expect(mark?.ways).toEqual([{ begin: null, end: [2, 1] }]);
    expect([mark!.begin, mark!.cutsBegin, mark!.cutsEnd]).toEqual([0, true, false]);
    expect(placeOfLabel(marks(gesture("tap", 0, 1e9, { places: [] }))[0]!)).toBeNull();
  });

  it("name what one touch may be once", () => {
    const possible = { verdict: "possible" } as const;
    const found = marks(gesture("tap", 1e9, 1.1e9), ...(["press", "hold"] as const).map((kind) => gesture(kind, 2e9, 2.5e9, { ...possible, contacts: [1] })));
    expect(texts(found)).toEqual(["certain tap", "possible press or hold"]);
    expect(found.map(labelText)).toEqual(["tap", "possible press or hold"]);
    const [many] = marks(...(["tap", "slide", "swipe"] as const).map((kind) => gesture(kind, 1e9, 2e9, possible)));
    expect(labelText(many!)).toBe("possible gesture");
    expect(kindText(many!)).toBe("tap, slide or swipe");
  });

  it("count touches that may be none, and never those that are certain", () => {
    const found = marks(stray(1e9), stray(1.01e9), stray(1.02e9), stray(2e9), stray(1e9, [1]), stray(1.01e9, [2]));
    expect(texts(found).toSorted()).toEqual(["possible tap", "possible tap", "possible tap", "possible tap, up to 3"]);
    expect(found.reduce((sum, { most }) => sum + most, 0)).toBe(6);
    expect(found.find(({ most }) => most === 3)?.ways).toHaveLength(3);
  });

  it.each([
    [[-0.1, 0.1], "→"],
    [[0.7, 0.9], "↗"],
    [[1.5, 1.6], "↑"],
    [[3.1, 3.2], "←"],
    [[-3.14, -3.1], "←"],
    [[-1.6, -1.5], "↓"],
    [[6.2, 6.3], "→"],
    [[4.6, 4.8], "↓"],
  ] as const)("point where a direction of %s rad goes", ([lo, hi], sign) => {
    expect(kindText(marks(gesture("swipe", 0, 1e9, { direction: { lo, hi } }))[0]!)).toBe(`swipe ${sign}`);
  });

  it("name no direction that is known too little", () => {
    expect(kindText(marks(gesture("slide", 0, 1e9, { direction: { lo: -0.5, hi: 0.5 } }))[0]!)).toBe("slide");
  });
});

describe("gestures of overlapping windows", () => {
  it("are listed once", () => {
    const log = new GestureLog(10);
    for (const [x0, x1] of [[0, 3e9], [1e9, 4e9], [1.05e9, 5e9]] as const) log.put({ x0, x1 }, marks(gesture("tap", 1.1e9, 1.2e9)));
    expect(texts(log.latest(9e9, 5))).toEqual(["certain tap"]);
  });

  it("stay as they were seen whole, though a later window cuts them", () => {
    const log = new GestureLog(10);
    log.put(WINDOW, marks(gesture("press", 1e9, 1.5e9)));
    const cut = gesture("press", null, 1.5e9, { verdict: "possible" });
    const later = { x0: 1.2e9, x1: 4.2e9 };
    log.put(later, marksOf([cut], later, timeline));
    expect(texts(log.latest(9e9, 5))).toEqual(["certain press"]);
  });

  it("are replaced by what is known better", () => {
    const log = new GestureLog(10);
    log.put(WINDOW, marks(gesture("hold", 2e9, null, { verdict: "possible" })));
    const later = { x0: 1e9, x1: 5e9 };
    log.put(later, marksOf([gesture("hold", 2e9, 4e9)], later, timeline));
    expect(texts(log.latest(9e9, 5))).toEqual(["certain hold"]);
    log.put(later, []);
    expect(log.latest(9e9, 5)).toEqual([]);
  });

  it("are shown from their begin until some time after their end, certain ones first", () => {
    const log = new GestureLog(10);
    log.put(WINDOW, marks(gesture("slide", 1e9, 2e9, { verdict: "possible", contacts: [1] }), gesture("tap", 1.5e9, 1.6e9)));
    expect(log.at(0.9e9, 1e9)).toEqual([]);
    expect(texts(log.at(1.5e9, 1e9))).toEqual(["certain tap", "possible slide"]);
    expect(texts(log.at(2.7e9, 1e9))).toEqual(["possible slide"]);
    expect(log.at(3.1e9, 1e9)).toEqual([]);
  });

  it("are shown with the latest of a kind first", () => {
    const log = new GestureLog(10);
    log.put(WINDOW, marks(gesture("press", 1e9, 1.3e9), stray(1.9e9), gesture("press", 1.5e9, 1.8e9, { contacts: [1] }), stray(1.6e9, [2])));
    expect(log.at(2e9, 1e9).map(({ begin, touched }) => [begin, touched])).toEqual([[1.5e9, true], [1e9, true], [1.6e9, true], [1.9e9, false]]);
  });

  it("are few", () => {
    const log = new GestureLog(3);
    log.put(WINDOW, marks(...[0, 1, 2, 3, 4].map((k) => gesture("tap", k * 5e8, k * 5e8 + 1e8, { contacts: [k] }))));
    expect(log.latest(9e9, 9).map(({ begin }) => begin)).toEqual([2e9, 1.5e9, 1e9]);
  });
});

describe("the window that is asked for", () => {
  it("is short live, and reaches back to where a touch began that goes on", () => {
    expect(askedLive(20e9, null)).toEqual({ x0: 17e9, x1: 20e9 });
    expect(askedLive(20e9, 19e9)).toEqual({ x0: 17e9, x1: 20e9 });
    expect(askedLive(20e9, 15e9).x0).toBeLessThan(15e9);
    expect(askedLive(20e9, 2e9)).toEqual({ x0: 10e9, x1: 20e9 });
  });

  it("is that of the past which is shown, or a part around the position", () => {
    expect(askedOf({ x0: 0, x1: 5e9 }, 1e9)).toEqual({ x0: -1e9, x1: 6e9 });
    for (const position of [0, 1e9, 33.3e9, -7e9]) {
      const { x0, x1 } = askedOf({ x0: -1e12, x1: 1e12 }, position);
      expect(x1 - x0).toBeLessThan(10e9);
      expect(position - x0).toBeGreaterThanOrEqual(1e9);
      expect(x1 - position).toBeGreaterThanOrEqual(1e9);
    }
  });
});
