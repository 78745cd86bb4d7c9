import { describe, expect, test } from "vitest";
import { ColourScale, LEVELS, niceAbove, pixel, ramp } from "../src/skin/colour-scale";
import { pitchOf, type Skin } from "../src/skin/layout";
import { CERTAIN, IMPOSSIBLE, judgeAll, Painter, POSSIBLE, UNKNOWN } from "../src/skin/painter";
import { type Raster, rasterise, taxelAt, taxelBeside, taxelsWithin } from "../src/skin/raster";
import { emptyPicture, type Picture } from "../src/skin/stretches";

/** A grid of taxels a millimetre apart, row by row from below. */
function gridOf(columns: number, rows: number): Skin {
  const numbers = Array.from({ length: columns * rows }, (_, k) => k);
  return {
    quantity: "pressure",
    unit: "Pa",
    taxels: numbers.map((k) => `t${k}`),
    nodes: numbers.map(() => "hand"),
    x: Float64Array.from(numbers, (k) => 1e-3 * (k % columns)),
    y: Float64Array.from(numbers, (k) => 1e-3 * Math.floor(k / columns)),
    patches: [],
    outline: [],
    threshold: 100,
  };
}

const colours = { values: ["#000000", "#0000ff"], ground: "#ffffff", missing: "#777777", certain: "#ff0000", possible: "#00ff00", rim: "#123456" };

/** Paints pictures on a canvas of memory; gives the colours of the pixels of a taxel. */
function studio(skin: Skin, size: number): { paint: (picture: Picture) => void; coloursOf: (taxel: number) => Set<number>; copied: () => number } {
  const raster = rasterise(skin, { width: size, height: size }, 1);
  let image: { data: Uint8ClampedArray } | null = null;
  let rows = 0;
  const context = {
    createImageData: (width: number, height: number) => (image = { data: new Uint8ClampedArray(4 * width * height) }),
    putImageData: (...all: number[]) => (rows += all[6]!),
  } as unknown as CanvasRenderingContext2D;
  const painter = new Painter(context, raster, 1, colours);
  const scale = new ColourScale(skin.threshold);
  return {
    paint: (picture) => {
      rows = 0;
      painter.paint(picture, skin.threshold, scale);
    },
    coloursOf: (taxel) => {
      const pixels = new Uint32Array(image!.data.buffer);
      const found = new Set<number>();
      for (const [at, owner] of raster.owners.entries()) if (owner === taxel) found.add(pixels[at]!);
      return found;
    },
    copied: () => rows,
  };
}

function pictureOf(skin: Skin, lo: (taxel: number) => number, hi: (taxel: number) => number): Picture {
  const picture = emptyPicture(skin);
  for (let k = 0; k < skin.taxels.length; k += 1) [picture.lo[k], picture.hi[k]] = [lo(k), hi(k)];
  return picture;
}

describe("where taxels lie", () => {
  test("the picture has the whole outline, and the taxels keep their places on it", () => {
    const room = { width: 200, height: 200 };
    const outline = [{ x: [-0.004, 0.011, 0.011, -0.004], y: [-0.002, -0.002, 0.009, 0.009] }];
    const [bare, drawn] = [gridOf(8, 6), { ...gridOf(8, 6), outline }].map((skin) => rasterise(skin, room, 1)) as [Raster, Raster];
    const [left, bottom] = drawn.place(-0.004, -0.002);
    const [right, top] = drawn.place(0.011, 0.009);
    expect(Math.min(left, top)).toBeGreaterThanOrEqual(0);
    expect(right).toBeLessThanOrEqual(drawn.width);
    expect(bottom).toBeLessThanOrEqual(drawn.height);
    expect(drawn.width).toBeLessThanOrEqual(200);
    expect(drawn.cell).toBeLessThan(bare.cell);
    expect([drawn.x[9], drawn.y[9]]).toEqual([...drawn.place(0.001, 0.001)]);
    expect(drawn.owners[Math.floor(drawn.y[9]!) * drawn.width + Math.floor(drawn.x[9]!)]).toBe(9);
  });

  test("the pitch is that of neighbours, whatever the grid", () => {
    expect(pitchOf(gridOf(80, 60))).toBeCloseTo(1e-3, 9);
    expect(pitchOf(gridOf(1, 30))).toBeCloseTo(1e-3, 9);
    expect(pitchOf({ x: Float64Array.of(0), y: Float64Array.of(0) })).toBeGreaterThan(0);
  });

  test.each([40, 160, 600])("every taxel has pixels of its own, in %i pixels, and y points upwards", (size) => {
    const skin = gridOf(8, 6);
    const raster = rasterise(skin, { width: size, height: size }, 1);
    expect(raster.width).toBeLessThanOrEqual(Math.max(size, 16));
    const owned = new Set(raster.owners);
    for (let k = 0; k < 48; k += 1) {
      expect(owned).toContain(k);
      expect(taxelAt(raster, raster.x[k]!, raster.y[k]!)).toBe(k);
      expect(raster.starts[k + 1]! - raster.starts[k]!).toBe(raster.owners.filter((owner) => owner === k).length);
    }
    expect(raster.y[47]!).toBeLessThan(raster.y[0]!);
  });

  test("keys go to the neighbour in their direction, and stay at the edge", () => {
    const raster = rasterise(gridOf(8, 6), { width: 160, height: 160 }, 1);
    expect(taxelBeside(raster, 9, [1, 0])).toBe(10);
    expect(taxelBeside(raster, 9, [0, -1])).toBe(17);
    expect(taxelBeside(raster, 0, [-1, 0])).toBe(0);
  });

  test("a box holds the taxels whose centres are in it", () => {
    const raster = rasterise(gridOf(8, 6), { width: 160, height: 160 }, 1);
    const box = { x0: raster.x[9]! - 1, x1: raster.x[18]! + 1, y0: raster.y[18]! - 1, y1: raster.y[9]! + 1 };
    expect(taxelsWithin(raster, box)).toEqual([9, 10, 17, 18]);
  });
});

describe("verdicts", () => {
  test("follow from the bounds and the threshold; what is unknown is not judged", () => {
    const skin = gridOf(6, 1);
    const bounds = [[101, 120], [99, 120], [80, 100], [-Infinity, Infinity], [-Infinity, 101], [101, Infinity]];
    const picture = pictureOf(skin, (k) => bounds[k]![0]!, (k) => bounds[k]![1]!);
    const verdicts = new Uint8Array(6);
    judgeAll(picture, 100, verdicts);
    expect([...verdicts]).toEqual([CERTAIN, POSSIBLE, IMPOSSIBLE, UNKNOWN, POSSIBLE, CERTAIN]);
    judgeAll(picture, null, verdicts);
    expect([...verdicts]).toEqual([IMPOSSIBLE, IMPOSSIBLE, IMPOSSIBLE, UNKNOWN, IMPOSSIBLE, IMPOSSIBLE]);
  });
});

const skin = gridOf(8, 6);

describe("painted pixels", () => {
  test("show the lower bound, and the upper one in stripes", () => {
    const { paint, coloursOf } = studio(skin, 80);
    const values = ramp(colours.values);
    paint(pictureOf(skin, () => 0, () => 90));
    const scale = new ColourScale(100);
    expect(coloursOf(9)).toEqual(new Set([values[0]!, values[scale.level(90)]!]));
    paint(pictureOf(skin, () => 0, () => 0.5));
    expect(coloursOf(9)).toEqual(new Set([values[0]!]));
  });

  test("a line runs around what is certainly pressed, none between two such taxels", () => {
    const { paint, coloursOf } = studio(skin, 80);
    const pressed = new Set([9, 10, 11, 17, 18, 19, 25, 26, 27]);
    paint(pictureOf(skin, (k) => (pressed.has(k) ? 500 : 0), (k) => (pressed.has(k) ? 501 : 1)));
    expect(coloursOf(17)).toContain(pixel(colours.certain));
    expect(coloursOf(18)).not.toContain(pixel(colours.certain));
    expect(coloursOf(33)).not.toContain(pixel(colours.certain));
  });

});

describe("from picture to picture", () => {
  test("unknown taxels are hatched, and keep nothing of what was known before", () => {
    const { paint, coloursOf } = studio(skin, 80);
    paint(pictureOf(skin, () => 400, () => 450));
    paint(emptyPicture(skin));
    expect(coloursOf(18)).toEqual(new Set([pixel(colours.ground), pixel(colours.missing)]));
  });

  test("only rows of what has changed, and of its neighbours, are copied", () => {
    const { paint, coloursOf, copied } = studio(skin, 80);
    const touched = pictureOf(skin, (k) => (k === 18 ? 500 : 0), (k) => (k === 18 ? 501 : 1));
    paint(touched);
    paint(touched);
    expect(copied()).toBe(0);
    paint(pictureOf(skin, () => 0, () => 1));
    expect(copied()).toBe(30);
    expect(coloursOf(18)).toEqual(new Set([ramp(colours.values)[0]!]));
  });
});

describe("the colour scale", () => {
  test("has room above the threshold, grows with what is measured, and never shrinks", () => {
    const scale = new ColourScale(1000);
    expect(scale.hi).toBe(6000);
    expect(scale.grow(Float64Array.of(5000), Float64Array.of(9000))).toBe(false);
    expect(scale.grow(Float64Array.of(7001), Float64Array.of(9000))).toBe(true);
    expect(scale.hi).toBe(8000);
    expect(scale.grow(Float64Array.of(1), Float64Array.of(2))).toBe(false);
    expect([scale.level(-5), scale.level(0), scale.level(8000), scale.level(Infinity)]).toEqual([0, 0, LEVELS - 1, LEVELS - 1]);
  });

  test("without a threshold it begins with the first picture that is known", () => {
    const scale = new ColourScale(null);
    expect(scale.grow(Float64Array.of(-Infinity), Float64Array.of(Infinity))).toBe(false);
    expect(scale.grow(Float64Array.of(30.9, 31.4), Float64Array.of(31.2, 31.8))).toBe(true);
    expect(scale.lo).toBeLessThanOrEqual(30.9);
    expect(scale.hi).toBeGreaterThanOrEqual(31.8);
  });

  test("round numbers are not below what is asked for", () => {
    for (const value of [1, 1.01, 3.4e4, 9.99e-7, 123]) {
      expect(niceAbove(value)).toBeGreaterThanOrEqual(value * (1 - 1e-9));
      expect(niceAbove(value)).toBeLessThan(2.001 * value);
    }
  });
});
