import type { Range } from "../state/window";
import {
  byColumn, type Column, COLUMNS, copyOf, endOf, type Entries, firstAtOrAfter, firstBeyond, goesOn, part, stopOf,
} from "./entries";
import { unite } from "./join";

const FIRST_SIZE = 512;

/**
 * A bounded buffer of entries for a rolling window. When it is full, neighbours are joined to their
 * hull, so that memory stays bounded and the picture still encloses every sample.
 */
export class Tube {
  private readonly arrays: { [Name in Column]: Float64Array };
  private start = 0;
  private end = 0;

  constructor(private readonly capacity: number) {
    const size = Math.min(FIRST_SIZE, 2 * capacity);
    this.arrays = byColumn(() => new Float64Array(size));
  }

  get size(): number {
    return this.end - this.start;
  }

  /** The entries held now, without copying; valid until the next change. */
  view(): Entries {
    return byColumn((column) => this.arrays[column].subarray(this.start, this.end));
  }

  clear(): void {
    this.start = 0;
    this.end = 0;
  }

  /**
   * Puts a run in its place in time. Of a stretch of which something is known already, both hold: neither a run
   * nor the earlier data is known to hold all samples there, and the last hull of a run claims more time
   * than its samples take.
   */
  merge(run: Entries): void {
    const begin = run.t[0];
    const stop = endOf(run);
    if (begin === undefined || stop === null) return;
    const held = this.view();
    const from = firstBeyond(held, begin);
    if (from === held.t.length) {
      this.append(run);
      return;
    }
    // The neighbours on both sides show whether the data continue without a break.
    const first = Math.max(0, from - 1);
    const after = Math.min(held.t.length, firstAtOrAfter(held.t, stop) + 2);
    const known = copyOf(part(held, first, after));
    const tail = copyOf(part(held, after, held.t.length));
    const shared = firstAtOrAfter(run.t, endOf(known)!) + 2;
    this.end = this.start + first;
    this.append(unite(known, part(run, 0, shared)));
    this.append(part(run, shared, run.t.length));
    this.append(tail);
  }

  /** Replaces [x0, x1) by the store's answer, which holds every sample there. */
  replace({ x0, x1 }: Range, run: Entries): void {
    const held = this.view();
    const to = firstAtOrAfter(held.t, x1);
    const rest = to > 0 ? endOf(part(held, 0, to))! - x1 : 0;
    const tail = copyOf(part(held, rest > 0 ? to - 1 : to, held.t.length));
    if (rest > 0) [tail.t[0], tail.width[0]] = [x1, rest];
    const from = firstBeyond(held, x0);
    const cut = from < held.t.length && held.t[from]! < x0;
    if (cut) held.width[from] = x0 - held.t[from]!;
    this.end = this.start + (cut ? from + 1 : from);
    this.append(tail);
    this.merge(run);
  }

  /** Forgets the entries that end before x. */
  evictBefore(x: number): void {
    const { t, width } = this.arrays;
    while (this.start < this.end && t[this.start]! + width[this.start]! < x) this.start += 1;
  }

  private append(run: Entries): void {
    const count = run.t.length;
    // Also where nothing is added: what was united before it may be more than fits.
    while (this.size + count > this.capacity && this.size > 1) {
      if (!this.coalesce()) this.start += Math.ceil(this.size / 2);
    }
    if (count === 0) return;
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
    const held = this.view();
    const { t, width, lo, hi, doubt, error, reach } = held;
    let out = 0;
    for (let i = 0; i < t.length; out += 1) {
      const pair = this.joins(held, i);
      const last = pair ? i + 1 : i;
      const stop = pair ? Math.max(stopOf(held, i), stopOf(held, last)) : t[i]! + width[i]!;
      const joined = pair ? doubt[i]! + doubt[last]! : doubt[i]!;
      [t[out], width[out]] = [t[i]!, stop - t[i]!];
      [lo[out], hi[out]] = [Math.min(lo[i]!, lo[last]!), Math.max(hi[i]!, hi[last]!)];
      [doubt[out], error[out]] = [joined, Math.max(error[i]!, error[last]!)];
      reach[out] = reach[last]!;
      i = last + 1;
    }
    this.end = this.start + out;
    return out < t.length;
  }

  private joins(held: Entries, i: number): boolean {
    if (i + 1 >= held.t.length) return false;
    const known = !Number.isNaN(held.lo[i]!);
    if (known !== !Number.isNaN(held.lo[i + 1]!)) return false;
    return !known || goesOn(held, i);
  }
}
