import { describe, expect, it } from "vitest";
import type { EventItem } from "../src/api/contract";
import { what } from "../src/view/event-list";

const SQUEEZE: EventItem = {
  id: "1",
  node: "fingertip",
  channel: null,
  kind: "verdict",
  verdict: "possible",
  time: { lo: "2027-01-15T08:00:00.000000000Z", hi: "2027-01-15T08:00:00.004000000Z" },
  height: null,
  prominence: null,
  count: null,
  unit: null,
  coverage: 1,
  boot: 1,
  detail: '{"monitor":"squeeze","final":true,"because":["width","gap"]}',
};

describe("the text of an event", () => {
  it("names the monitor and why its verdict is possible", () => {
    expect(what(SQUEEZE)).toBe("squeeze: by width, gap");
  });

  it("names the monitor alone where its verdict is decided", () => {
    const decided = '{"monitor":"squeeze","final":true,"because":[]}';
    expect(what({ ...SQUEEZE, verdict: "certain", detail: decided })).toBe("squeeze");
  });
});
