import { describe, expect, it } from "vitest";
import type { NodeState } from "../src/api/contract";
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
      { target: "t01", name: "gain", desired: null, reported: "1", settled: true },
      { target: "t01", name: "rate", desired: "50", reported: "100", settled: false },
    ]);
  });

  it("compares what is desired of the whole node with each taxel", () => {
    const rows = settingRows(state({ "*": { rate: 50 }, t02: { rate: 7 } }, { t01: { rate: 50 }, t02: { rate: 7 }, t03: { rate: 9 } }));
    expect(rows.map((row) => [row.target, row.desired, row.reported, row.settled])).toEqual([
      ["*", "50", "t01: 50, t03: 9", false],
      ["t01", "50", "50", true],
      ["t02", "7", "7", true],
      ["t03", "50", "9", false],
    ]);
  });

  it("shows a desired setting that no node has reported", () => {
    expect(settingRows(state({ "*": { mode: "peaks" } }, null))).toEqual([
      { target: "*", name: "mode", desired: "peaks", reported: null, settled: false },
    ]);
    expect(settingRows(state({}, null))).toEqual([]);
  });
});
