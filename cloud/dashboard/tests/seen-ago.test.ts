import { expect, test } from "vitest";
import { seenAgo } from "../src/view/fact";

const NOW = BigInt(Date.parse("2026-01-31T12:00:00Z")) * 1_000_000n;

test("what was heard ahead of the page's clock was not heard now", () => {
  expect(seenAgo("2026-01-31T12:00:01.000000000Z", NOW)).toMatch(/, now$/);
  expect(seenAgo("2026-01-31T11:59:00.000000000Z", NOW)).toMatch(/, 1 min ago$|, 60 s ago$/);
  expect(seenAgo("2026-01-31T12:30:00.000000000Z", NOW)).not.toMatch(/now|ago/);
});
