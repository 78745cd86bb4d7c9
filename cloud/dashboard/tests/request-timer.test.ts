import { afterEach, expect, test, vi } from "vitest";
import type { View } from "../src/state/route";
import { RequestTimer } from "../src/view/question-parts";

const LIVE: View = { kind: "live", span: 10e9 };
const PAST: View = { kind: "history", from: 0n, to: 1n };

afterEach(() => {
  vi.restoreAllMocks();
});

test("while a window moves it is asked every other second, and a slow answer is waited for", () => {
  const clock = new RequestTimer();
  expect([clock.isDue(2_001, PAST), clock.isDue(2_001, LIVE)]).toEqual([false, true]);
  clock.ask(2_001);
  expect(clock.isDue(30_000, LIVE)).toBe(false);
  clock.answered();
  expect([clock.isDue(4_000, LIVE), clock.isDue(4_002, LIVE)]).toEqual([false, true]);
});

test("an answer that does not come is not waited for without end", () => {
  const clock = new RequestTimer();
  clock.ask(1_000);
  expect([clock.isDue(31_000, LIVE), clock.isDue(31_001, LIVE)]).toEqual([false, true]);
});

test("another window is asked for at once when it has settled", () => {
  vi.spyOn(performance, "now").mockReturnValue(5_000);
  const clock = new RequestTimer();
  clock.ask(4_900);
  clock.settle();
  expect([clock.isDue(5_199, PAST), clock.isDue(5_200, PAST)]).toEqual([false, true]);
});
