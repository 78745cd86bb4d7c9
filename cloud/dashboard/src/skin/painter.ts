import { ColourScale, LEVELS, pixel, ramp } from "./colour-scale";
import type { Raster } from "./raster";
import type { Picture } from "./stretches";

/** Whether a taxel is pressed: as docs/contacts.md has it. */
export const UNKNOWN = 0;
export const IMPOSSIBLE = 1;
export const POSSIBLE = 2;
export const CERTAIN = 3;

/** Judges each taxel against the threshold; without one, none is pressed. */
export function judgeAll({ lo, hi }: Picture, threshold: number | null, verdicts: Uint8Array): void {
  const level = threshold ?? Infinity;
  for (let k = 0; k < verdicts.length; k += 1) {
    if (lo[k] === -Infinity && hi[k] === Infinity) verdicts[k] = UNKNOWN;
    else if (lo[k]! > level) verdicts[k] = CERTAIN;
    else verdicts[k] = threshold !== null && hi[k]! > level ? POSSIBLE : IMPOSSIBLE;
  }
}

export interface SkinColours {
  /** From the least to the greatest value, `#rrggbb` each. */
  readonly values: readonly string[];
  readonly ground: string;
  readonly missing: string;
  readonly certain: string;
  readonly possible: string;
  /** Of the skin's own edge. */
  readonly rim: string;
}

type Marks = Record<Exclude<keyof SkinColours, "values">, number>;

/** A dashed line is drawn for so many CSS pixels, then left out for as many. */
const DASH = 3;

/**
 * Paints pictures of a skin. The colour is that of a taxel's lower bound, its stripes have that of its upper bound: the
 * wider the interval, the plainer they stand out. A line runs around what is certainly pressed, a dashed one around
 * what possibly is. Only taxels that have changed are painted.
 */
export class Painter {
  readonly verdicts: Uint8Array;
  private readonly shown: Int32Array;
  private readonly before: Uint8Array;
  private readonly dirty: Uint8Array;
  private readonly image: ImageData;
  private readonly pixels: Uint32Array;
  private values: Uint32Array;
  private marks: Marks;
  private readonly dash: number;

  constructor(private readonly context: CanvasRenderingContext2D, private readonly raster: Raster, ratio: number, colours: SkinColours) {
    const count = raster.x.length;
    this.verdicts = new Uint8Array(count);
    this.before = new Uint8Array(count);
    this.dirty = new Uint8Array(count);
    this.shown = new Int32Array(count).fill(-1);
    this.image = context.createImageData(raster.width, raster.height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.values = ramp(colours.values);
    this.marks = marksOf(colours);
    this.dash = Math.max(2, Math.round(DASH * ratio));
  }

  /** Takes other colours: all is painted again. */
  recolour(colours: SkinColours): void {
    this.values = ramp(colours.values);
    this.marks = marksOf(colours);
    this.invalidate();
  }

  /** Paints all taxels the next time. */
  invalidate(): void {
    this.shown.fill(-1);
  }

  /** Paints a picture. */
  paint(picture: Picture, threshold: number | null, scale: ColourScale): void {
    judgeAll(picture, threshold, this.verdicts);
    this.mark(picture, scale);
    let [top, bottom] = [this.raster.height, 0];
    for (let k = 0; k < this.dirty.length; k += 1) {
      if (this.dirty[k] === 0) continue;
      this.dirty[k] = 0;
      this.fill(k);
      if (this.raster.tops[k]! < top) top = this.raster.tops[k]!;
      if (this.raster.bottoms[k]! > bottom) bottom = this.raster.bottoms[k]!;
    }
    if (top < bottom) this.context.putImageData(this.image, 0, 0, 0, top, this.raster.width, bottom - top);
  }

  /** Finds which taxels have changed; where a verdict has, the lines around its neighbours may, too. */
  private mark({ lo, hi }: Picture, scale: ColourScale): void {
    const { verdicts, before, shown, dirty } = this;
    const { beyond, edgeStarts } = this.raster;
    for (let k = 0; k < verdicts.length; k += 1) {
      const verdict = verdicts[k]!;
      const look = verdict === UNKNOWN ? 0 : 1 + scale.level(lo[k]!) * LEVELS + scale.level(hi[k]!);
      if (look !== shown[k]) dirty[k] = 1;
      shown[k] = look;
      if (verdict === before[k]) continue;
      before[k] = verdict;
      dirty[k] = 1;
      for (let edge = edgeStarts[k]!; edge < edgeStarts[k + 1]!; edge += 1) if (beyond[edge]! >= 0) dirty[beyond[edge]!] = 1;
    }
  }

  private fill(k: number): void {
    const { pixels, verdicts, marks } = this;
    const { starts, stripes, edges, beyond, edgeStarts, width } = this.raster;
    const look = this.shown[k]! - 1;
    const own = this.raster.pixels;
    const plain = look < 0 ? marks.ground : this.values[Math.floor(look / LEVELS)]!;
    const stripe = look < 0 ? marks.missing : this.values[look % LEVELS]!;
    const end = starts[k + 1]!;
    const middle = stripes[k]!;
    for (let i = starts[k]!; i < middle; i += 1) pixels[own[i]!] = plain;
    for (let i = middle; i < end; i += 1) pixels[own[i]!] = stripe;
    const verdict = verdicts[k]!;
    if (verdict < POSSIBLE) {
      for (let edge = edgeStarts[k]!; edge < edgeStarts[k + 1]!; edge += 1) if (beyond[edge]! < 0) pixels[edges[edge]!] = marks.rim;
      return;
    }
    for (let edge = edgeStarts[k]!; edge < edgeStarts[k + 1]!; edge += 1) {
      const other = beyond[edge]!;
      if (other >= 0 && verdicts[other]! >= verdict) continue;
      const at = edges[edge]!;
      if (verdict === CERTAIN) pixels[at] = marks.certain;
      else if ((((at % width) + Math.floor(at / width)) / this.dash) % 2 < 1) pixels[at] = marks.possible;
    }
  }
}

function marksOf(colours: SkinColours): Marks {
  const { ground, missing, certain, possible, rim } = colours;
  return { ground: pixel(ground), missing: pixel(missing), certain: pixel(certain), possible: pixel(possible), rim: pixel(rim) };
}
