import { describe, expect, test } from "vitest";
import { Turns } from "../src/api/turns";

function stand(): { turns: Turns; clock: { ms: number }; asked: AbortSignal[]; answer: () => Promise<void>; idle: () => number } {
  const clock = { ms: 0 };
  const asked: AbortSignal[] = [];
  const waiting: (() => void)[] = [];
  let idle = 0;
  const turns = new Turns({
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
  return { turns, clock, asked, answer, idle: () => idle };
}

describe("questions of which only the newest counts", () => {
  test("the first is asked at once, and many that come meanwhile make one more", async () => {
    const { turns, asked, answer, idle } = stand();
    turns.ask();
    expect(asked).toHaveLength(1);
    for (let i = 0; i < 10; i += 1) turns.ask();
    expect(asked).toHaveLength(1);
    await answer();
    expect([asked.length, idle()]).toEqual([2, 0]);
    await answer();
    expect([asked.length, idle()]).toEqual([2, 1]);
    expect(asked.some((signal) => signal.aborted)).toBe(false);
  });

  test("a slow one is given up for a newer one", async () => {
    const { turns, clock, asked, answer, idle } = stand();
    turns.ask();
    clock.ms = 1000;
    turns.ask();
    expect(asked.map((signal) => signal.aborted)).toEqual([true, false]);
    await answer();
    expect(idle()).toBe(0);
    await answer();
    expect(idle()).toBe(1);
  });

  test("more of the same waits for the answer to a slow one", async () => {
    const { turns, clock, asked, answer, idle } = stand();
    turns.follow();
    clock.ms = 10_000;
    turns.follow();
    expect(asked.map((signal) => signal.aborted)).toEqual([false]);
    await answer();
    expect([asked.length, idle()]).toEqual([2, 0]);
    await answer();
    expect(idle()).toBe(1);
  });

  test("after a stop nothing is asked, until somebody asks again", async () => {
    const { turns, asked, answer, idle } = stand();
    turns.ask();
    turns.ask();
    turns.stop();
    expect(asked[0]!.aborted).toBe(true);
    await answer();
    expect([asked.length, idle()]).toEqual([1, 0]);
    turns.ask();
    expect(asked).toHaveLength(2);
  });
});
