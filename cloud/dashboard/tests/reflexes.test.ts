import { describe, expect, it } from "vitest";
import type { NodeMonitorItem } from "../src/api/contract";
import { parseInstant } from "../src/time/instant";
import { isSettled, outputText, verdictText } from "../src/view/node-reflexes";

const SETTINGS = { formula: "t01.pressure > 3 kPa", on: "possible", output: "stop" } as const;
const LO = "2026-01-31T12:00:00.250000000Z";
const NOW = parseInstant("2026-01-31T12:01:00Z");

function monitor(more: Partial<NodeMonitorItem> = {}, latest: Partial<NonNullable<NodeMonitorItem["latest"]>> = {}): NodeMonitorItem {
  const time = { lo: LO, hi: "2026-01-31T12:00:00.251000000Z" };
  const stated = { verdict: "certain", time, final: true, because: [], coverage: 1, current: true, ...latest } as const;
  return { name: "grip", ...SETTINGS, desired: null, reported: SETTINGS, latest: stated, level: "on", ...more };
}

describe("a reflex", () => {
  it("is said with its verdict, why it is possible, and since when", () => {
    expect(verdictText(monitor(), NOW)).toMatch(/^certain since \d\d:00:00\.25$/);
    expect(verdictText(monitor({}, { verdict: "possible", because: ["width", "gap"] }), NOW)).toMatch(/^possible by width, gap since /);
    expect(verdictText(monitor({ latest: null }), NOW)).toBe("no verdict yet");
  });

  it("is unknown of a node that is silent, which stated something once", () => {
    expect(verdictText(monitor({ level: null }, { current: false }), NOW)).toMatch(/^unknown now; certain at \d\d:00:00\.25$/);
    const days = NOW + 10n * 86_400_000_000_000n;
    expect(verdictText(monitor({ level: null }, { current: false }), days)).toMatch(/certain at 2026-0\d-\d\d \d\d:/);
  });

  it("says the level of its output, and never one that is not known", () => {
    expect(outputText(monitor())).toBe("stop on");
    expect(outputText(monitor({ level: "off" }))).toBe("stop off");
    expect(outputText(monitor({ level: null }))).toBe("stop unknown");
    expect(outputText(monitor({ output: "none", level: null }))).toBe("no output");
  });

  it("waits until the node reports what is desired", () => {
    expect(isSettled(monitor())).toBe(true);
    expect(isSettled(monitor({ desired: SETTINGS }))).toBe(true);
    expect(isSettled(monitor({ desired: { ...SETTINGS, on: "certain" } }))).toBe(false);
    expect(isSettled(monitor({ desired: SETTINGS, reported: null }))).toBe(false);
  });
});
