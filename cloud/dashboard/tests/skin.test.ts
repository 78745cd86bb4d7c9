import { expect, test } from "vitest";
import type { ChannelItem } from "../src/api/contract";
import { hullOf } from "../src/skin/latest-values";
import { judge, layOut, levelOf, PITCH, quantitiesOf } from "../src/skin/taxels";

function channel(id: string, bounds: ChannelItem["bounds"]): ChannelItem {
  const [taxel = "", quantity = ""] = id.split(".");
  return { id, taxel, quantity, unit: "F", coverage: 1, dt: 1, blocks: 1, samples: 1, bytes: 4, first: null, last: null, bounds, biometric: false, patch: null, removed: null };
}

test("contact is certain above a level, possible across it, and impossible below", () => {
  expect(judge({ lo: 1.1, hi: 2 }, 1)).toBe("certain");
  expect(judge({ lo: 1, hi: 2 }, 1)).toBe("possible");
  expect(judge({ lo: -Infinity, hi: Infinity }, 1)).toBe("possible");
  expect(judge({ lo: 0, hi: 1 }, 1)).toBe("impossible");
  expect(judge({ lo: Number.NaN, hi: Number.NaN }, 1)).toBe("unknown");
  expect(judge(null, 1)).toBe("unknown");
});

test("a block's hull takes in unbounded sides and leaves out what is missing", () => {
  expect(hullOf({ lo: [1, null, 3], hi: [2, null, 5] })).toEqual({ lo: 1, hi: 5 });
  expect(hullOf({ lo: [1, null], hi: [2, 4] })).toEqual({ lo: -Infinity, hi: 4 });
  expect(hullOf({ lo: [null], hi: [null] })).toBeNull();
});

test("pressure is offered first, and only what several taxels have", () => {
  const all = ["t01.capacitance", "t02.capacitance", "t01.pressure", "t02.pressure", "t01.temperature", "a01.humidity"];
  const channels = all.map((id) => channel(id, null));
  expect(quantitiesOf(channels, new Set(["t01", "t02"]))).toEqual(["pressure", "capacitance"]);
});

test("a level starts as a light touch, or in the middle of what was measured", () => {
  const channels = [channel("t01.capacitance", { lo: 1, hi: 3 }), channel("t02.capacitance", { lo: 2, hi: 9 })];
  expect(levelOf(channels, "capacitance")).toBe(5);
  expect(levelOf([channel("t01.pressure", null)], "pressure")).toBe(1000);
  expect(levelOf([channel("t01.capacitance", { lo: null, hi: 2 })], "capacitance")).toBe(0);
});

function close(value: number, wanted: number): void {
  expect(value).toBeCloseTo(wanted, 9);
}

test("a skin is drawn with y upwards and the nearest taxels a pitch apart", () => {
  const { spots, width, height } = layOut([
    { id: "t00", position_m: [0.01, 0] },
    { id: "t01", position_m: [0.03, 0] },
    { id: "t02", position_m: [0.01, 0.04] },
  ]);
  close(spots[1]!.x - spots[0]!.x, PITCH);
  close(spots[0]!.y - spots[2]!.y, 2 * PITCH);
  close(width, 2 * PITCH);
  close(height, 3 * PITCH);
  expect(layOut([{ id: "t00", position_m: [0.5, 0.5] }])).toEqual({ spots: [{ taxel: "t00", x: 10, y: 10 }], width: PITCH, height: PITCH });
});
