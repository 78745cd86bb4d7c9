import { describe, expect, test } from "vitest";
import { type Columns, OPEN_BOTTOM, OPEN_TOP, rasterBand } from "../src/chart/band";

const HEIGHT = 8;
const INK = { fill: 1, edge: 2, line: 1 };

/** The rows of a band with these stretches, one sign a pixel. */
function painted(stretches: readonly (readonly [top: number, bottom: number, open?: number])[]): string[] {
  const columns: Columns = {
    top: Int32Array.from(stretches, ([top]) => top),
    bottom: Int32Array.from(stretches, ([, bottom]) => bottom),
    open: Uint8Array.from(stretches, ([, , open]) => open ?? 0),
  };
  const width = stretches.length;
  const pixels = new Uint32Array(width * HEIGHT).fill(9);
  rasterBand(columns, pixels, INK);
  return Array.from({ length: HEIGHT }, (_, row) => [...pixels.subarray(row * width, (row + 1) * width)].map((pixel) => ".#="[pixel]).join(""));
}

describe("the pixels of a band", () => {
  test("all of every stretch is painted, with its outline within", () => {
    expect(painted([[1, 6], [1, 6], [1, 6]])).toEqual(["...", "===", "###", "###", "###", "===", "...", "..."]);
  });

  test("upright steps join the outline of neighbours", () => {
    expect(painted([[0, 5], [3, 8]])).toEqual(["=.", "=.", "=.", "#=", "=#", ".=", ".=", ".="]);
  });

  test("a column without a value stays empty, whatever was there before", () => {
    expect(painted([[2, 4], [0x7fffffff, -1], [2, 4]]).map((row) => row[1])).toEqual(Array.from({ length: HEIGHT }, () => "."));
  });

  test("where a value is unbounded there is no edge", () => {
    expect(painted([[0, 8, OPEN_TOP]]).join("")).toBe("#######=");
    expect(painted([[0, 8, OPEN_BOTTOM]]).join("")).toBe("=#######");
  });

  test("a stretch as thin as its outline is painted whole and not beyond", () => {
    expect(painted([[7, 8], [0, 1]])).toEqual([".=", "..", "..", "..", "..", "..", "..", "=."]);
  });
});
