import { describe, expect, test } from "vitest";
import { address, Client } from "../src/api/client";
import type { ModelItem } from "../src/api/contract";
import { reduceToColumns } from "../src/chart/band";
import { readPrediction } from "../src/chart/predicted";
import { finiteExtentOf } from "../src/chart/value-range";
import { parseTyped, printTyped, shortTyped } from "../src/interval/typed";
import { Timeline } from "../src/time/timeline";
import { NOTHING } from "../src/tube/entries";

const ORIGIN = 1_795_229_398_000_000_000n;

describe("what is typed", () => {
  test("a number cut short is the very one that its text names", () => {
    for (let i = 1; i < 1000; i += 1) {
      const { text, value } = shortTyped(i * 1.2345e-14, -12, 3);
      expect(value).toBe(Number(`${text}e-12`));
      expect(parseTyped(text, -12)).toBe(value);
    }
  });

  test("is read in its prefix", () => {
    expect(parseTyped("12.5", -12)).toBe(12.5e-12);
    expect(parseTyped(" −0,5 ", -3)).toBe(-0.5e-3);
    expect(parseTyped("1e3", -6)).toBe(1e-3);
    for (const text of ["", "five", "1 2", "--1", "1e", "1e999"]) expect(parseTyped(text, 0)).toBeNull();
  });

  test("every number reads back as itself", () => {
    const numbers = [0, 9e-12, 1.1e-11, 0.1 + 0.2, 1 / 3, 8.854e-12, -5e-324, 1.7976931348623157e308, 1000, 1e21, 123_456_789.125];
    for (const value of numbers) {
      for (const exponent of [-12, -9, -3, 0, 3, 12]) expect(parseTyped(printTyped(value, exponent), exponent)).toBe(value);
    }
  });

  test("is printed plainly", () => {
    expect(printTyped(9e-12, -12)).toBe("9");
    expect(printTyped(1.1e-11, -12)).toBe("11");
    expect(printTyped(4.5e-3, -3)).toBe("4.5");
    expect(printTyped(1500, 0)).toBe("1500");
    expect(printTyped(0.05, 0)).toBe("0.05");
  });
});

describe("a predicted tube", () => {
  const timeline = new Timeline(ORIGIN);
  const answer = { t0: "2026-11-21T00:49:58.000000005Z", t: [0, 100, 200], lo: [1, null, 3], hi: [2, 4, null], dt: 100 };

  test("is unbounded, never missing, where a side is null", () => {
    const entries = readPrediction(answer, timeline);
    expect([...entries.lo]).toEqual([1, -Infinity, 3]);
    expect([...entries.hi]).toEqual([2, 4, Infinity]);
    expect([...entries.width]).toEqual([100, 100, 100]);
  });

  test("is painted over all of each entry's width and bounds", () => {
    const entries = readPrediction({ ...answer, t0: new Date(Number(ORIGIN / 1_000_000n)).toISOString(), lo: [1, 2, 3], hi: [2, 3, 4] }, timeline);
    const map = { width: 30, height: 40, xMin: 0, xMax: 300, yMin: 0, yMax: 5 };
    const { top, bottom } = reduceToColumns(entries, map, { halfMark: 1, thickness: 1 });
    for (let column = 0; column < 30; column += 1) {
      const entry = Math.floor(column / 10);
      expect(top[column]).toBeLessThanOrEqual(40 - 8 * (entry + 2));
      expect(bottom[column]).toBeGreaterThanOrEqual(40 - 8 * (entry + 1));
    }
  });

  test("belongs to the scale of values, also where nothing was measured", () => {
    const entries = readPrediction(answer, timeline);
    const from = entries.t[0]!;
    expect(finiteExtentOf([NOTHING, entries], from, from + 300)).toEqual({ min: 1, max: 4 });
    expect(finiteExtentOf([NOTHING], 0, 1)).toBeNull();
  });
});

describe("the questions", () => {
  test("parameters are repeated in the address", () => {
    expect(address("/x", { parameter: ["a:1:2", "b:3:4"], model: "touch.area", limit: undefined })).toBe(
      "/api/v1/x?parameter=a%3A1%3A2&parameter=b%3A3%3A4&model=touch.area",
    );
  });

  test("a refusal shows the cloud's reason", async () => {
    const body = JSON.stringify({ title: "Unprocessable", detail: "parameter: distance is missing", status: 422 });
    const options = { status: 422, headers: { "content-type": "application/problem+json" } };
    const client = new Client({ fetch: () => Promise.resolve(new Response(body, options)), onUnauthorised: () => {} });
    const query = { model: "touch.area", origin: ORIGIN, parameter: [], start: ORIGIN, end: ORIGIN + 1n };
    const asked = client.anomaliesTime({ node: "n", channel: "c" }, query, new AbortController().signal);
    await expect(asked).rejects.toThrow("Unprocessable: parameter: distance is missing");
  });

  test("models are listed", async () => {
    const items: ModelItem[] = [{ id: "constant", unit: null, description: "a band", parameters: [] }];
    const answer = (): Promise<Response> => Promise.resolve(Response.json({ items, next: null }));
    const client = new Client({ fetch: answer, onUnauthorised: () => {} });
    expect(await client.models(new AbortController().signal)).toEqual(items);
  });
});
