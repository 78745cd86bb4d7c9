import { expect, test } from "vitest";
import { formatLag } from "../src/time/duration";
import { formatBytes } from "../src/view/fact";

test("a lag is printed outward", () => {
  expect(formatLag(null)).toBe("–");
  expect(formatLag({ lo_ns: 12_345_678, hi_ns: 15_000_001 })).toBe("12.34–15.01 ms");
  expect(formatLag({ lo_ns: 999_000_000, hi_ns: 2_000_000_000 })).toBe("999 ms – 2 s");
  expect(formatLag({ lo_ns: -5, hi_ns: 3_000_000 })).toBe("≤ 3 ms");
  expect(formatLag({ lo_ns: 3_000_000, hi_ns: 3_000_000 })).toBe("3 ms");
});

test("bytes are rounded up", () => {
  expect(formatBytes(0)).toBe("0 B");
  expect(formatBytes(1025)).toBe("1.1 KiB");
  expect(formatBytes(1024 ** 3)).toBe("1 GiB");
});
