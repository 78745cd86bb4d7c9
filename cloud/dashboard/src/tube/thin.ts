import type { Entries } from "./entries";

/**
 * Joins the entries of a run to hulls, one for each stretch of `grain` ns: what is finer cannot be seen, and
 * would only be painted again and again. Never across a break, and never what is known with what is not.
 */
export function thin(run: Entries, grain: number): Entries {
  const size = run.t.length;
  if (size < 2 || grain <= 0) return run;
  const { reach } = run;
  const [t, width, lo, hi] = [run.t.slice(), run.width.slice(), run.lo.slice(), run.hi.slice()];
  let last = 0;
  for (let i = 1; i < size; i += 1) {
    const stop = t[last]! + width[last]!;
    const near = Math.floor(run.t[i]! / grain) === Math.floor(t[last]! / grain) && run.t[i]! - stop <= reach;
    if (near && Number.isNaN(lo[last]!) === Number.isNaN(run.lo[i]!)) {
      width[last] = Math.max(stop, run.t[i]! + run.width[i]!) - t[last]!;
      if (run.lo[i]! < lo[last]!) lo[last] = run.lo[i]!;
      if (run.hi[i]! > hi[last]!) hi[last] = run.hi[i]!;
    } else {
      last += 1;
      [t[last], width[last], lo[last], hi[last]] = [run.t[i]!, run.width[i]!, run.lo[i]!, run.hi[i]!];
    }
  }
  const end = last + 1;
  return { t: t.subarray(0, end), width: width.subarray(0, end), lo: lo.subarray(0, end), hi: hi.subarray(0, end), reach };
}
