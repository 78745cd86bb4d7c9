import { expect, it } from "vitest";
import { nameError } from "../src/view/alarm-board";

it("accepts the names that the cloud accepts, and complains of all others", () => {
  for (const name of ["a", "7", "left-grip", "a--b", "x".repeat(63)]) expect(nameError(name)).toBeNull();
  for (const name of ["Always on", "Grip", "-a", "a-", "a_b", "ä", "x".repeat(64), "evaluation"]) expect(nameError(name)).not.toBeNull();
});
