import { describe, expect, test } from "vitest";
import { complete, isComplete, offerAt } from "../src/view/formula-completion";

const CHANNELS = [
  { id: "t01.energy", unit: "J" }, { id: "t02.energy", unit: "J" }, { id: "board.temperature", unit: "Cel" },
  { id: "skin-1.area", unit: "m2" }, { id: "load", unit: "%" }, { id: "taps", unit: "1" },
];

/** What is offered where the text has a bar. */
function offered(marked: string): string[] {
  return offerAt(marked.replace("|", ""), marked.indexOf("|"), CHANNELS).choices.map(({ label }) => label);
}

/** The text, with a bar at the caret, after the choice with a label. */
function chosen(marked: string, label: string): string {
  const [text, caret] = [marked.replace("|", ""), marked.indexOf("|")];
  const offer = offerAt(text, caret, CHANNELS);
  const done = complete(text, caret, offer, offer.choices.find((choice) => choice.label === label)!);
  return `${done.text.slice(0, done.caret)}|${done.text.slice(done.caret)}`;
}

describe("what a formula may go on with", () => {
  test("channels and operators where a value is expected, those first that begin so", () => {
    expect(offered("t0|")).toEqual(["t01.energy", "t02.energy"]);
    expect(offered("not en|")).toEqual(["t01.energy", "t02.energy"]);
    expect(offered("a|")).toEqual(["always", "abs", "board.temperature", "skin-1.area", "load", "taps"]);
    expect(offered("once[0,50ms] t01|.")).toEqual(["t01.energy"]);
    expect(offered("max(t01.energy, t02|")).toEqual(["t02.energy"]);
  });

  test("all operators are offered, each where it may stand", () => {
    const prefix = ["always", "eventually", "historically", "once", "rise", "fall", "count", "delay", "abs", "min", "max", "not"];
    const infix = ["and", "or", "implies", "until", "since"];
    for (const word of prefix) {
      expect(offered(`${word.slice(0, -1)}|`)).toContain(word);
      expect(offered(`load > 3 % ${word.slice(0, 2)}|`)).not.toContain(word);
    }
    for (const word of infix) {
      expect(offered(`load > 3 % ${word.slice(0, -1)}|`)).toContain(word);
      expect(offered(`${word.slice(0, 2)}|`)).not.toContain(word);
    }
  });

  test("a number has the units of the channel before it", () => {
    expect(offered("t01.energy > 6 |")).toEqual(["J", "mJ", "uJ", "nJ", "pJ", "kJ", "MJ"]);
    expect(offered("t01.energy > 6 p|")).toEqual(["pJ"]);
    expect(offered("t01.energy > 6p| and load > 1")).toEqual(["pJ"]);
    expect(offered("t01.energy > 6 pJ and load > 1.5e3 |")).toEqual(["%"]);
    expect(offered("board.temperature > 30 C|")).toEqual(["Cel"]);
    expect(offered('"skin-1.area" > 3 mm|')).toEqual(["mm2"]);
    expect(offered("taps > 3 |")).toEqual([]);
    expect(offered("unknown.channel > 3 |")).toEqual([]);
  });

  test("a number in a window has units of time", () => {
    expect(offered("once[0,50|")).toEqual(["ms", "s", "us", "min", "ns", "h", "d"]);
    expect(offered("once[0,50m|")).toEqual(["ms", "min"]);
    expect(offered("once[0,50ms] t01.energy > 5 n|")).toEqual(["nJ"]);
    expect(offered("once[|")).toEqual([]);
  });

  test("a number without a unit may be followed by an operator", () => {
    expect(offered("taps > 3 an|")).toEqual(["and"]);
  });

  test("within quotes only channels are offered", () => {
    expect(offered('t01.energy > 1 pJ and "a|')).toEqual(["board.temperature", "skin-1.area", "load", "taps"]);
    expect(offered('"skin-1.area" a|')).toEqual(["and"]);
  });

  test("nothing is left to complete of a word that is there", () => {
    expect(isComplete(offerAt("t01.energy", 10, CHANNELS))).toBe(true);
    expect(isComplete(offerAt("t01.energ", 9, CHANNELS))).toBe(false);
    expect(isComplete(offerAt("t01.energy > 6 pJ", 17, CHANNELS))).toBe(true);
    expect(isComplete(offerAt("t01.energy > 6 ", 15, CHANNELS))).toBe(false);
  });
});

describe("what a choice writes", () => {
  test("it replaces the word that was begun, and no more", () => {
    expect(chosen("not t0| > 3", "t02.energy")).toBe("not t02.energy| > 3");
    expect(chosen("t01.energy > 6 | and load > 1", "pJ")).toBe("t01.energy > 6 pJ| and load > 1");
  });

  test("an operator comes with its bracket, but not with a second one", () => {
    expect(chosen("on|", "once")).toBe("once[0,|");
    expect(chosen("on|[0,1s] load > 1", "once")).toBe("once|[0,1s] load > 1");
    expect(chosen("ri|", "rise")).toBe("rise(|");
    expect(chosen("ri|(load > 1)", "rise")).toBe("rise(|load > 1)");
    expect(chosen("load > 1 an|", "and")).toBe("load > 1 and |");
    expect(chosen("load > 1 an| taps > 1", "and")).toBe("load > 1 and |taps > 1");
  });

  test("a channel whose name has other characters stands in quotes", () => {
    expect(chosen("ar|", "skin-1.area")).toBe('"skin-1.area"|');
    expect(chosen('"ar|" > 1', "skin-1.area")).toBe('"skin-1.area"| > 1');
  });
});
