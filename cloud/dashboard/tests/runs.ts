import type { Entries } from "../src/tube/entries";

/** A run of entries, one each step. */
export function run(from: number, values: readonly (readonly [number, number])[], width = 0, step = 10): Entries {
  return {
    t: Float64Array.from(values, (_, i) => from + i * step),
    width: new Float64Array(values.length).fill(width),
    lo: Float64Array.from(values, ([lo]) => lo),
    hi: Float64Array.from(values, ([, hi]) => hi),
    doubt: new Float64Array(values.length),
    error: new Float64Array(values.length),
    reach: new Float64Array(values.length).fill(1.5 * step),
  };
}

/** Numbers in [0, 1) that are the same each time. */
export function random(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state * 1_103_515_245 + 12_345) % 2 ** 31;
    return state / 2 ** 31;
  };
}

export const GAP = [Number.NaN, Number.NaN] as const;
