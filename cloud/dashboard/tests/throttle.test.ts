import { expect, test } from "vitest";
import { Throttle } from "../src/time/throttle";

test("a beat comes once in each period, in the same frame for all who wait for it", () => {
  const frames = Array.from({ length: 63 }, (_, i) => 1234 + i * 16);
  const [one, other] = [new Throttle(200), new Throttle(200)];
  const first = frames.filter((at) => one.due(at));
  expect(other.due(1300)).toBe(true);
  const later = frames.filter((at) => at > 1300 && other.due(at));
  expect(first.length).toBe(6);
  expect(later).toEqual(first.filter((at) => at > 1300));
});

test("a beat that was reset comes at once", () => {
  const beat = new Throttle(200);
  expect([beat.due(0), beat.due(10)]).toEqual([true, false]);
  beat.reset();
  expect(beat.due(20)).toBe(true);
});
