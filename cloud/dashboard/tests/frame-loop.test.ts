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

test("a browser that is late is asked for 35 frames a second, and for all again once it keeps pace", () => {
  const seconds: number[] = [];
  new FrameLoop(() => (seconds[Math.floor(now / 1000)] = (seconds[Math.floor(now / 1000)] ?? 0) + 1)).start();
  while (now < 40_000) {
    now += now < 2_000 ? 1.5 * FRAME_MS : FRAME_MS;
    for (const call of waiting.splice(0)) call(now);
  }
  expect(seconds[1]).toBeGreaterThan(38);
  for (const each of seconds.slice(4, 20)) expect(Math.abs(each - 35)).toBeLessThanOrEqual(1);
  for (const each of seconds.slice(25, 39)) expect(each).toBeGreaterThanOrEqual(59);
});
