import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { FrameLoop } from "../src/live/frame-loop";

const FRAME_MS = 1000 / 60;
let now = 0;
let waiting: FrameRequestCallback[] = [];

beforeEach(() => {
  now = 0;
  waiting = [];
  vi.stubGlobal("requestAnimationFrame", (call: FrameRequestCallback) => waiting.push(call));
  vi.stubGlobal("matchMedia", () => ({ matches: false }));
  vi.spyOn(performance, "now").mockImplementation(() => now);
});

afterEach(() => {
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

/** How many of some frames are painted, of which each takes so long. */
function painted(frames: number, cost: (frame: number) => number): number {
  let count = 0;
  let frame = 0;
  new FrameLoop(() => {
    count += 1;
    now += cost(frame);
  }).start();
  for (; frame < frames; frame += 1) {
    now = frame * FRAME_MS;
    for (const call of waiting.splice(0)) call(now);
  }
  return count;
}

test("each frame is painted, also when now and then one takes long, as those with texts do", () => {
  expect(painted(120, (frame) => (frame % 12 === 0 ? 12 : 4))).toBe(120);
});

test("every other frame is left out when painting always takes long, and more when longer", () => {
  expect(painted(120, () => 9)).toBeLessThan(70);
  expect(painted(120, () => 9)).toBeGreaterThan(55);
  expect(painted(120, () => 20)).toBeLessThan(40);
});
