import { expect, it } from "vitest";
import { untilNow } from "../src/state/window";

it("shows nothing that is still to come, unless there is nothing else", () => {
  expect(untilNow({ x0: 0, x1: 100 }, 70.4)).toEqual({ x0: 0, x1: 71 });
  expect(untilNow({ x0: 0, x1: 50 }, 70)).toEqual({ x0: 0, x1: 50 });
  expect(untilNow({ x0: 80, x1: 100 }, 70)).toEqual({ x0: 80, x1: 100 });
});
