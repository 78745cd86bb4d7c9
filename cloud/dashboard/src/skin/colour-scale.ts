/** How many colours a scale has. */
export const LEVELS = 96;
/** Against a threshold: so much room above it, to begin with. */
const ROOM = 6;
const STEPS = [1, 1.5, 2, 3, 4, 5, 6, 8, 10];

/** The least round number that a value does not exceed. */
export function niceAbove(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return (STEPS.find((step) => step * power >= value * (1 - 1e-9)) ?? 10) * power;
}

/** From values to colours. It grows with what is measured and never shrinks, so that a colour keeps its meaning. */
export class ColourScale {
  lo = 0;
  hi = 0;

  constructor(threshold: number | null) {
    if (threshold !== null) this.hi = niceAbove(ROOM * threshold);
  }

  /** Takes in the known bounds of a picture; true if the scale has changed. */
  grow(lo: Float64Array, hi: Float64Array): boolean {
    let [lowest, highest] = [Infinity, -Infinity];
    for (let k = 0; k < lo.length; k += 1) {
      if (lo[k]! > highest && lo[k]! < Infinity) highest = lo[k]!;
      if (lo[k]! < lowest && lo[k]! > -Infinity) lowest = lo[k]!;
      if (this.hi === this.lo && hi[k]! > highest && hi[k]! < Infinity) highest = hi[k]!;
    }
    if (lowest > highest) return false;
    const fresh = this.hi === this.lo;
    if (!fresh && highest <= this.hi) return false;
    if (fresh) {
      const step = niceAbove(Math.max(highest - lowest, 1e-3 * Math.abs(highest), 1e-12));
      this.lo = Math.floor(lowest / step) * step;
      this.hi = Math.ceil(highest / step) * step || this.lo + step;
    } else this.hi = this.lo + niceAbove(highest - this.lo);
    return true;
  }

  /** The colour's number of a value, from 0 to LEVELS - 1. */
  level(value: number): number {
    const share = (value - this.lo) / (this.hi - this.lo || 1);
    return share <= 0 ? 0 : share >= 1 ? LEVELS - 1 : Math.floor(share * LEVELS);
  }
}

type Stop = readonly [number, number, number];

function parseColour(text: string): Stop {
  const match = /^#(..)(..)(..)$/.exec(text);
  if (!match) throw new RangeError(`not a colour: "${text}"; give #rrggbb`);
  return [parseInt(match[1]!, 16), parseInt(match[2]!, 16), parseInt(match[3]!, 16)];
}

/** A colour as a pixel of image data on little-endian machines, as all that run browsers are. */
export function pixelOf([red, green, blue]: Stop): number {
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

/** Colours between the given ones, as pixels. */
export function ramp(stops: readonly string[]): Uint32Array {
  const parsed = stops.map(parseColour);
  return Uint32Array.from({ length: LEVELS }, (_, level) => {
    const at = (level / (LEVELS - 1)) * (parsed.length - 1);
    const before = Math.min(Math.floor(at), parsed.length - 2);
    const mix = (part: 0 | 1 | 2): number => Math.round(parsed[before]![part] + (at - before) * (parsed[before + 1]![part] - parsed[before]![part]));
    return pixelOf([mix(0), mix(1), mix(2)]);
  });
}

/** One colour, as a pixel. */
export function pixel(colour: string): number {
  return pixelOf(parseColour(colour));
}
