import { expect, test } from "vitest";
import type { FaultJson } from "../src/api/contract";
import { faultsText } from "../src/view/node-cards";

function fault(taxel: string, dead: FaultJson["dead"], stuck: FaultJson["stuck"]): FaultJson {
  return { taxel, dead, stuck };
}

test("certainly broken taxels are named, possibly broken ones are counted", () => {
  const faults = [
    fault("t03", "certain", "possible"),
    fault("t05", "impossible", "certain"),
    fault("t06", "impossible", "possible"),
    fault("t07", "possible", "possible"),
  ];
  expect(faultsText(faults)).toBe("t03 dead, t05 stuck, 2 possibly");
});

test("where no taxel can be broken, none is", () => {
  expect(faultsText([])).toBe("none");
});
