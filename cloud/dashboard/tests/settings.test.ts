import { describe, expect, it } from "vitest";
import type { CommandItem, NodeState } from "../src/api/contract";
import { settingRows } from "../src/view/node-settings";

function state(desired: NodeState["desired"], reported: NodeState["reported"]): NodeState {
  return {
    node: "fingertip",
    desired,
    desired_at: null,
    desired_by: null,
    reported,
    reported_at: null,
    reported_by: null,
    settled: false,
  };
}

describe("settings", () => {
  it("keeps what is desired and what is reported apart", () => {
    const rows = settingRows(state({ t01: { rate: 50 } }, { t01: { rate: 100, gain: 1 } }));
    expect(rows).toEqual([
      { target: "t01", name: "gain", desired: null, reported: "1", settled: true, failure: null },
      { target: "t01", name: "rate", desired: "50 Hz", reported: "100 Hz", settled: false, failure: null },
    ]);
  });

  it("compares what is desired of the whole node with each taxel", () => {
    const rows = settingRows(state({ "*": { rate: 50 }, t02: { rate: 7 } }, { t01: { rate: 50 }, t02: { rate: 7 }, t03: { rate: 9 } }));
    expect(rows.map((row) => [row.target, row.desired, row.reported, row.settled])).toEqual([
      ["*", "50 Hz", "t01: 50 Hz, t03: 9 Hz", false],
      ["t01", "50 Hz", "50 Hz", true],
      ["t02", "7 Hz", "7 Hz", true],
      ["t03", "50 Hz", "9 Hz", false],
    ]);
  });

  it("shows a desired setting that no node has reported", () => {
    expect(settingRows(state({ "*": { mode: "peaks" } }, null))).toEqual([
      { target: "*", name: "mode", desired: "peaks", reported: null, settled: false, failure: null },
    ]);
    expect(settingRows(state({}, null))).toEqual([]);
  });

  it("have the units of their channels, and name the very numbers that are set", () => {
    const settings = { t01: { rate: 100_000, smoothing: 0.1 }, "t01.capacitance": { threshold: 4e-11 }, "t02.distance": { threshold: 0.012_345_678_9 } };
    const units = new Map([["t01.capacitance", "F"], ["t02.distance", "m"]]);
    const rows = settingRows(state(settings, settings), units);
    expect(rows.map((row) => row.reported)).toEqual(["100 kHz", "0.1", "40 pF", "12.3456789 mm"]);
    expect(rows.every((row) => row.settled)).toBe(true);
    expect(settingRows(state({}, settings)).find(({ name }) => name === "threshold")?.reported).toBe("4e-11");
  });

  it("that a node refused differ from those that it has not answered", () => {
    const given = { id: 7, node: "fingertip", name: "set", arguments: { rate: 5e4 }, issued: "", expires: "", delivered: null, answered: null } as const;
    const waiting = state({ "*": { rate: 5e4 }, t02: { rate: 7 }, "t01.area": { threshold: 1 } }, { t01: { rate: 100 }, t02: { rate: 9 } });
    const failures = (command: Partial<CommandItem>): unknown[] => settingRows(waiting, new Map(), { ...given, state: "pending", reason: null, ...command })
      .filter(({ failure }) => failure !== null)
      .map(({ target, failure }) => [target, failure]);
    expect(failures({})).toEqual([]);
    expect(failures({ state: "refused", reason: "at most 1000" })).toEqual([["*", "refused"], ["t01", "refused"]]);
    expect(failures({ state: "refused", reason: "no", arguments: { rate: 7, taxel: "t02" } })).toEqual([["t02", "refused"]]);
    expect(failures({ state: "expired", reason: "late", arguments: { threshold: 1, channel: "t01.area" } })).toEqual([["t01.area", "expired"]]);
    expect(failures({ state: "refused", reason: "no", arguments: { gain: 2 } })).toEqual([]);
  });
});
