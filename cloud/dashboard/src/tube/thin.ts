import { COLUMNS, copyOf, part, stopOf, type Entries } from "./entries";

/**
 * Joins the entries of a run to hulls, one for each stretch of `grain` ns: what is finer cannot be seen, and
 * would only be painted again and again. Never across a break, and never what is known with what is not.
 */
export function thin(run: Entries, grain: number): Entries {
  const size = run.t.length;
  if (size < 2 || grain <= 0) return run;
  const few = copyOf(run);
  const { t, width, lo, hi, doubt, error, reach } = few;
  let last = 0;
  for (let i = 1; i < size; i += 1) {
    const stop = t[last]! + width[last]!;
    const near = Math.floor(run.t[i]! / grain) === Math.floor(t[last]! / grain) && run.t[i]! - stop <= reach[last]!;
    if (near && Number.isNaN(lo[last]!) === Number.isNaN(run.lo[i]!)) {
      width[last] = Math.max(stop, stopOf(run, i)) - t[last]!;
      if (run.lo[i]! < lo[last]!) lo[last] = run.lo[i]!;
      if (run.hi[i]! > hi[last]!) hi[last] = run.hi[i]!;
      if (run.error[i]! > error[last]!) error[last] = run.error[i]!;
      doubt[last]! += run.doubt[i]!;
      reach[last] = run.reach[i]!;
    } else {
      last += 1;
      for (const column of COLUMNS) few[column][last] = run[column][i]!;
    }
  }
  return part(few, 0, last + 1);
}
