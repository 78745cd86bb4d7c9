import { expect, test } from "vitest";
import { outboxBytes } from "../src/view/node-card";

test("how full an outbox is, or that this is sealed, or nothing where nothing is known", () => {
  expect(outboxBytes({ outbox: { messages: 3, bytes: 1024, capacity_bytes: 1_048_576 } })).toBe("outbox 1 KiB of 1 MiB");
  expect(outboxBytes({ outbox: { messages: 3, bytes: null, capacity_bytes: 1_048_576 } })).toBe("outbox of 1 MiB; what is taken of it is sealed");
  expect(outboxBytes({ outbox: null })).toBeNull();
});
