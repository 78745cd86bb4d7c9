import { expect, test } from "vitest";
import type { EnergyJson } from "../src/api/contract";
import { batteryText } from "../src/view/node-cards";

const energy: EnergyJson = {
  stored: { lo: 0.2, hi: 0.3 },
  charge: { lo: 0.509, hi: 0.601 },
  self_sustaining: "possible",
  shedding: "none",
};

test("a battery's charge is rounded outward", () => {
  expect(batteryText(energy)).toBe("50–61 % · may sustain itself");
});

test("an unbounded charge is anything, and shed load is stated", () => {
  const charge = { lo: null, hi: null };
  expect(batteryText({ ...energy, charge, self_sustaining: "impossible", shedding: "peaks" })).toBe(
    "0–100 % · discharges · sheds to peaks",
  );
});
