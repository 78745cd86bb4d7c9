import { expect, test } from "vitest";
import { storedText } from "../src/view/channel-detail";

test("size of a channel is shown whole and per sample, rounded up", () => {
  expect(storedText({ bytes: 2_097_152, samples: 1_000_000 })).toBe("2 MiB · 2.10 B per sample");
  expect(storedText({ bytes: 301, samples: 100 })).toBe("301 B · 3.01 B per sample");
});

test("what is empty takes nothing, and of what is sealed nothing is told", () => {
  expect(storedText({ bytes: 0, samples: 0 })).toBe("0 B");
  expect(storedText({ bytes: null, samples: 0 })).toBe("sealed");
});
