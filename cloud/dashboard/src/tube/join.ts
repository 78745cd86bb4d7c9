import { byColumn, type Column, COLUMNS, copyOf, type Entries, goesOn, part, stopOf } from "./entries";

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

/** One entry of a run. */
interface EntryRef {
  readonly run: Entries;
  readonly index: number;
}

function isKnown({ run, index }: EntryRef): boolean {
  return !Number.isNaN(run.lo[index]!);
}

/** Whether two entries are equal: then one repeats the other. */
function isSame(one: EntryRef, other: EntryRef): boolean {
  return (["t", "width", "lo", "hi"] as const).every((column) => one.run[column][one.index] === other.run[column][other.index]);
}

function distinct(entries: readonly EntryRef[]): readonly EntryRef[] {
  if (entries.length < 2) return entries;
  return entries.filter((one, index) => !entries.slice(0, index).some((other) => isSame(one, other)));
}

/** Reads a run from instant to instant. */
class Reader {
  private at = -1;

  constructor(private readonly run: Entries) {}

  /** Advances to an instant at which an entry begins or ends; returns the samples there. */
  goTo(x: number): EntryRef[] {
    const { t, width } = this.run;
    const samples: EntryRef[] = [];
    while (this.at + 1 < t.length && t[this.at + 1]! <= x) {
      this.at += 1;
      if (width[this.at] === 0) samples.push({ run: this.run, index: this.at });
    }
    return samples;
  }

  /** The hull that holds from here on, if one does. */
  cover(x: number): EntryRef[] {
    const { t, width } = this.run;
    const covers = this.at >= 0 && t[this.at]! + width[this.at]! > x;
    return covers ? [{ run: this.run, index: this.at }] : [];
  }

  /** Whether the last entry goes on to the next one without a break. */
  get goesOn(): boolean {
    const { run, at } = this;
    const next = at + 1;
    if (at < 0 || next >= run.t.length || Number.isNaN(run.lo[at]!) || Number.isNaN(run.lo[next]!)) return false;
    return goesOn(run, at);
  }
}

/** Collects entries in the order of time. */
class Writer {
  private readonly lists: Record<Column, number[]> = { t: [], width: [], lo: [], hi: [], doubt: [], error: [], reach: [] };

  /** The hull of some entries; their doubts add up. */
  add(t: number, width: number, entries: readonly EntryRef[]): void {
    let [lo, hi, doubt, error, reach] = [Infinity, -Infinity, 0, 0, 0];
    for (const { run, index } of entries) {
      lo = Math.min(lo, run.lo[index]!);
      hi = Math.max(hi, run.hi[index]!);
      doubt += run.doubt[index]!;
      error = Math.max(error, run.error[index]!);
      reach = Math.max(reach, run.reach[index]!);
    }
    this.push({ t, width, lo, hi, doubt, error, reach });
  }

  /** Nothing is known; that goes on where nothing was known before. */
  addMissing(t: number, width: number): void {
    const { lists } = this;
    const last = lists.t.length - 1;
    const stop = last >= 0 && Number.isNaN(lists.lo[last]) ? lists.t[last]! + lists.width[last]! : null;
    if (stop === t) lists.width[last]! += width;
    else this.push({ t, width, lo: Number.NaN, hi: Number.NaN, doubt: 0, error: 0, reach: 0 });
  }

  written(): Entries {
    return byColumn((column) => Float64Array.from(this.lists[column]));
  }

  private push(entry: Record<Column, number>): void {
    for (const column of COLUMNS) this.lists[column].push(entry[column]);
  }
}

/** All instants at which an entry begins or ends, each once. */
function edgesOf(runs: readonly Entries[]): Float64Array {
  const edges = new Float64Array(2 * runs.reduce((sum, { t }) => sum + t.length, 0));
  let at = 0;
  for (const { t, width } of runs) {
    for (let i = 0; i < t.length; i += 1) {
      edges[at] = t[i]!;
      edges[at + 1] = t[i]! + width[i]!;
      at += 2;
    }
  }
  edges.sort();
  return edges.filter((x, i) => x !== edges[i - 1]);
}

/**
 * What two runs say of the same channel, together: where hulls lie over each other, the hull of both; samples stay
 * what they are, and join the hull that they lie in. Nothing that either encloses is lost, for neither is known to
 * state all samples. Nothing is missing where one of both knows, or goes on without a break.
 */
export function unite(one: Entries, other: Entries): Entries {
  const readers = [new Reader(one), new Reader(other)];
  const writer = new Writer();
  const edges = edgesOf([one, other]);
  for (const [k, x] of edges.entries()) {
    const width = (edges[k + 1] ?? x) - x;
    const samples = distinct(readers.flatMap((reader) => reader.goTo(x)));
    const covers = distinct(readers.flatMap((reader) => reader.cover(x)));
    const known = samples.filter(isKnown);
    if (covers.some(isKnown)) writer.add(x, width, [...covers.filter(isKnown), ...known]);
    else {
      for (const sample of known) writer.add(x, 0, [sample]);
      if (readers.some((reader) => reader.goesOn)) continue;
      if (covers.length > 0) writer.addMissing(x, width);
      else if (samples.length > 0 && known.length === 0) writer.addMissing(x, 0);
    }
  }
  return writer.written();
}
