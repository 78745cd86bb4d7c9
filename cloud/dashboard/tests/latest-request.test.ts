import { describe, expect, test } from "vitest";
import { LatestRequest } from "../src/api/latest-request";

function stand(): { requests: LatestRequest; clock: { ms: number }; asked: AbortSignal[]; answer: () => Promise<void>; idle: () => number } {
  const clock = { ms: 0 };
  const asked: AbortSignal[] = [];
  const waiting: (() => void)[] = [];
  let idle = 0;
  const requests = new LatestRequest({
    ask: (signal) => {
      asked.push(signal);
      return new Promise((done) => waiting.push(done));
    },
    onIdle: () => (idle += 1),
    now: () => clock.ms,
  });
  const answer = async (): Promise<void> => {
    waiting.shift()?.();
    await new Promise((done) => setTimeout(done));
  };
  return { requests, clock, asked, answer, idle: () => idle };
}

describe("questions of which only the newest counts", () => {
  test("the first is asked at once, and many that come meanwhile make one more", async () => {
    const { requests, asked, answer, idle } = stand();
    requests.ask();
    expect(asked).toHaveLength(1);
    for (let i = 0; i < 10; i += 1) requests.ask();
    expect(asked).toHaveLength(1);
    await answer();
    expect([asked.length, idle()]).toEqual([2, 0]);
    await answer();
    expect([asked.length, idle()]).toEqual([2, 1]);
    expect(asked.some((signal) => signal.aborted)).toBe(false);
  });

  test("a slow one is given up for a newer one", async () => {
    const { requests, clock, asked, answer, idle } = stand();
    requests.ask();
    clock.ms = 1000;
    requests.ask();
    expect(asked.map((signal) => signal.aborted)).toEqual([true, false]);
    await answer();
    expect(idle()).toBe(0);
    await answer();
    expect(idle()).toBe(1);
  });

  test("sends nothing after a stop until the next request", async () => {
    const { requests, asked, answer, idle } = stand();
    requests.ask();
    requests.ask();
    requests.stop();
    expect(asked[0]!.aborted).toBe(true);
    await answer();
    expect([asked.length, idle()]).toEqual([1, 0]);
    requests.ask();
    expect(asked).toHaveLength(2);
  });
});
