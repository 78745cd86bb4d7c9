import { endOf, firstAtOrAfter, type Entries } from "./entries";

type Column = "t" | "width" | "lo" | "hi";
const COLUMNS: readonly Column[] = ["t", "width", "lo", "hi"];
const FIRST_SIZE = 512;

/**
 * A bounded buffer of entries for a rolling window. When it is full, neighbours are joined to their
 * hull, so that memory stays bounded and the picture still encloses every sample.
 */
export class Tube {
  private readonly arrays: Record<Column, Float64Array>;
  private start = 0;
  private end = 0;
  private reach = 0;

  constructor(private readonly capacity: number) {
    const size = Math.min(FIRST_SIZE, 2 * capacity);
    this.arrays = {
      t: new Float64Array(size),
      width: new Float64Array(size),
      lo: new Float64Array(size),
      hi: new Float64Array(size),
    };
  }

  get size(): number {
    return this.end - this.start;
  }

  /** The entries held now, without copying; valid until the next change. */
  view(): Entries {
    const { t, width, lo, hi } = this.arrays;
    return {
      t: t.subarray(this.start, this.end),
      width: width.subarray(this.start, this.end),
      lo: lo.subarray(this.start, this.end),
      hi: hi.subarray(this.start, this.end),
      reach: this.reach,
    };
  }

  clear(): void {
    this.start = 0;
    this.end = 0;
    this.reach = 0;
  }

  /**
   * Puts a run in its place in time; what was known of the same stretch is replaced by it. A held hull
   * that reaches into the run is cut: its bounds enclose the samples of what is left of it, too.
   */
  merge(run: Entries): void {
    const stop = endOf(run);
    if (stop === null) return;
    this.reach = Math.max(this.reach, run.reach);
    const { t, width } = this.arrays;
    const from = this.start + firstAtOrAfter(this.view().t, run.t[0]!);
    const tail = this.tailAfter(stop, run.width.at(-1) === 0);
    if (from > this.start) width[from - 1] = Math.min(width[from - 1]!, run.t[0]! - t[from - 1]!);
    this.end = from;
    this.append(run);
    if (tail.t.length > 0) this.append(tail);
  }

  /** A copy of what is held after `stop`; `told` if another sample has told of that instant itself. */
  private tailAfter(stop: number, told: boolean): Entries {
    const { t, width } = this.arrays;
    let to = this.start + firstAtOrAfter(this.view().t, stop);
    const rest = to > this.start ? t[to - 1]! + width[to - 1]! - stop : 0;
    if (told && to < this.end && t[to] === stop && width[to] === 0) to += 1;
    const tail = this.copy(rest > 0 ? to - 1 : to, this.end);
    if (rest > 0) {
      tail.t[0] = stop;
      tail.width[0] = rest;
    }
    return tail;
  }

  /** Forgets the entries that end before x. */
  evictBefore(x: number): void {
    const { t, width } = this.arrays;
    while (this.start < this.end && t[this.start]! + width[this.start]! < x) this.start += 1;
  }

  private copy(from: number, to: number): Entries {
    const { t, width, lo, hi } = this.arrays;
    return {
      t: t.slice(from, to),
      width: width.slice(from, to),
      lo: lo.slice(from, to),
      hi: hi.slice(from, to),
      reach: this.reach,
    };
  }

  private append(run: Entries): void {
    const count = run.t.length;
    while (this.size + count > this.capacity && this.size > 1) {
      if (!this.coalesce()) this.start += Math.ceil(this.size / 2);
    }
    this.makeRoom(count);
    for (const column of COLUMNS) this.arrays[column].set(run[column], this.end);
    this.end += count;
  }

  private makeRoom(count: number): void {
    const length = this.arrays.t.length;
    if (this.end + count <= length) return;
    const size = this.size;
    const next = Math.max(length, 2 * (size + count));
    for (const column of COLUMNS) {
      const moved = next > length ? new Float64Array(next) : this.arrays[column];
      moved.set(this.arrays[column].subarray(this.start, this.end));
      this.arrays[column] = moved;
    }
    this.start = 0;
    this.end = size;
  }

  /** Joins neighbours two by two, never across a gap; false when nothing could be joined. */
  private coalesce(): boolean {
    const { t, width, lo, hi } = this.arrays;
    const before = this.size;
    let out = this.start;
    for (let i = this.start; i < this.end; out += 1) {
      const pair = this.joins(i);
      const last = pair ? i + 1 : i;
      const stop = t[last]! + width[last]!;
      const low = Math.min(lo[i]!, lo[last]!);
      const high = Math.max(hi[i]!, hi[last]!);
      t[out] = t[i]!;
      width[out] = stop - t[out]!;
      lo[out] = low;
      hi[out] = high;
      i = last + 1;
    }
    this.end = out;
    return this.size < before;
  }

  private joins(i: number): boolean {
    const { t, width, lo } = this.arrays;
    if (i + 1 >= this.end) return false;
    const known = !Number.isNaN(lo[i]!);
    if (known !== !Number.isNaN(lo[i + 1]!)) return false;
    return !known || t[i + 1]! - t[i]! - width[i]! <= this.reach;
  }
}
