import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { FrameLoop } from "../src/live/frame-loop";

const FRAME_MS = 1000 / 60;
let now = 0;
let waiting: FrameRequestCallback[] = [];
let later: { readonly due: number; readonly call: () => void }[] = [];

/** The screen shows a frame at a time. */
function showFrame(at: number): void {
  const due = later.filter((each) => each.due <= at);
  later = later.filter((each) => each.due > at);
  now = at;
  for (const { call } of due) call();
  for (const call of waiting.splice(0)) call(at);
}

beforeEach(() => {
  now = 0;
  waiting = [];
  later = [];
  vi.stubGlobal("setTimeout", (call: () => void, delay: number) => later.push({ due: now + delay, call }));
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
  for (; frame < frames; frame += 1) showFrame(frame * FRAME_MS);
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

test("a browser that is late is asked for fewer frames, and for all again once it keeps pace", () => {
  const seconds: number[] = Array.from({ length: 40 }, () => 0);
  new FrameLoop(() => (seconds[Math.floor(now / 1000)]! += 1)).start();
  for (let at = 0; at < 40_000; at += at < 2_000 ? 1.5 * FRAME_MS : FRAME_MS) showFrame(at);
  expect(seconds[1]).toBeGreaterThan(38);
  for (const each of seconds.slice(4, 20)) expect(Math.abs(each - 35)).toBeLessThanOrEqual(6);
  for (const each of seconds.slice(26, 39)) expect(each).toBeGreaterThanOrEqual(59);
});
