import { describe, expect, test } from "vitest";
import { CloudClock } from "../src/live/cloud-clock";

const S = 1e9;
const DAY_MS = 86_400_000;

describe("the age of what comes", () => {
  test("is how long the cloud waited for it", () => {
    const clock = new CloudClock();
    clock.observe(100 * S, 0);
    expect(clock.ageOf(99 * S, 0)).toBe(S);
  });

  test("is that of now where a resumed stream brings what was received long ago", () => {
    const clock = new CloudClock();
    clock.observe(100 * S, 0);
    clock.observe(101 * S, 60_000);
    expect(clock.ageOf(101 * S, 60_000)).toBeGreaterThan(58 * S);
    clock.observe(160 * S, 60_100);
    expect(clock.ageOf(160 * S, 60_100)).toBeLessThan(S);
  });

  test("is known again with the first frame after the cloud's clock was set back", () => {
    const clock = new CloudClock();
    clock.observe(1000 * S, 0);
    clock.observe(400 * S, 100);
    expect(clock.ageOf(400 * S, 100)).toBe(0);
  });

  test("stays small beside a clock of the page that runs faster than the cloud's, day for day", () => {
    const clock = new CloudClock();
    const ages = Array.from({ length: 300 }, (_, day) => {
      const [received, at] = [day * DAY_MS * 1e6 * (1 - 5e-5), day * DAY_MS];
      clock.observe(received, at);
      return clock.ageOf(received, at);
    });
    expect(Math.max(...ages)).toBeLessThan(S);
  });
});
