import { describe, expect, test } from "vitest";
import { Playback } from "../src/skin/playback";

const STRETCH = 100e6;

/** Plays stretches that come at times (ms); gives when (ms) each position was shown first, at 60 frames a second. */
function play(arrivals: readonly number[]): { at: number; position: number }[] {
  const playback = new Playback();
  const shown: { at: number; position: number }[] = [];
  for (let at = 0; at < 2_000; at += 1000 / 60) {
    const come = arrivals.filter((arrival) => arrival <= at).length;
    const position = playback.move(at, come === 0 ? null : come * STRETCH, STRETCH);
    if (position !== null) shown.push({ at, position });
  }
  return shown;
}

describe("playing stretches", () => {
  test("each sample is shown one stretch after it was taken, and what it took to arrive", () => {
    const transport = 30;
    const arrivals = Array.from({ length: 18 }, (_, k) => 100 * (k + 1) + transport);
    const shown = play(arrivals).filter(({ at }) => at > 300 && at < 1_800);
    for (const { at, position } of shown) {
      const latency = at - position / 1e6;
      expect(latency).toBeGreaterThan(100 + transport - 17);
      expect(latency).toBeLessThan(100 + transport + 2 * 17);
    }
  });

  test("it never goes back, nor beyond what is there", () => {
    const arrivals = [100, 290, 295, 400, 620, 630, 640, 1_000];
    let before = -Infinity;
    for (const { at, position } of play(arrivals)) {
      expect(position).toBeGreaterThanOrEqual(before);
      expect(position).toBeLessThan(arrivals.filter((arrival) => arrival <= at).length * STRETCH);
      before = position;
    }
  });

  test("after a late stretch it catches up", () => {
    const arrivals = Array.from({ length: 18 }, (_, k) => 100 * (k + 1) + (k === 5 ? 90 : 0));
    const late = play(arrivals).filter(({ at }) => at > 1_400 && at < 1_800);
    for (const { at, position } of late) expect(at - position / 1e6).toBeLessThan(100 + 2 * 17);
  });

  test("after a leap of time it begins with the newest stretch", () => {
    const playback = new Playback();
    playback.move(0, STRETCH, STRETCH);
    expect(playback.move(10, 1e12, STRETCH)).toBe(1e12 - STRETCH);
    expect(playback.move(20, 5e11, STRETCH)).toBe(5e11 - STRETCH);
  });
});
