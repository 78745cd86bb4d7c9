import type { Frame, PatchSamples } from "../frames/frame";
import type { Timeline } from "../time/timeline";
import type { Taxels } from "./layout";

/** A decoded frame, and when its samples are from (ns of the timeline; the earliest instants). */
export interface Stretch {
  readonly page: number;
  readonly sequence: number;
  /** The frame's first instant, from which the delays of its grids count. */
  readonly origin: number;
  readonly begin: number;
  /** When the row after its last one is due. */
  readonly end: number;
  /** How much later its instants may be, in ns. */
  readonly error: number;
  /** By their number in the layout. */
  readonly patches: ReadonlyMap<number, PatchSamples>;
}

/** Reads when the samples of a frame are from. */
export function stretchOf(frame: Frame, timeline: Timeline): Stretch {
  const origin = timeline.toX(frame.time[0]);
  let [begin, end] = [Infinity, -Infinity];
  for (const { grid } of frame.patches) {
    begin = Math.min(begin, origin + grid.delay);
    end = Math.max(end, origin + grid.delay + grid.rows * grid.period);
  }
  const patches = new Map(frame.patches.map((samples) => [samples.patch, samples]));
  return { page: frame.page, sequence: frame.sequence, origin, begin, end, error: Number(frame.time[1] - frame.time[0]), patches };
}

/** Bounds of each taxel of a skin at one instant; unbounded on both sides where nothing is known. */
export interface Picture {
  readonly lo: Float64Array;
  readonly hi: Float64Array;
  /** The instant of the newest sample in it (ns of the timeline); NaN where nothing is known. */
  newest: number;
}

export function emptyPicture(skin: Pick<Taxels, "taxels">): Picture {
  const count = skin.taxels.length;
  return { lo: new Float64Array(count).fill(-Infinity), hi: new Float64Array(count).fill(Infinity), newest: Number.NaN };
}

/** The decoded frames of one page, in the order of time. */
class Page {
  readonly stretches: Stretch[] = [];

  /** Puts a stretch in its place; a repeated one changes nothing. */
  put(stretch: Stretch): void {
    const { stretches } = this;
    let place = stretches.length;
    while (place > 0 && stretches[place - 1]!.begin > stretch.begin) place -= 1;
    if (stretches[place - 1]?.begin === stretch.begin) return;
    stretches.splice(place, 0, stretch);
  }

  get end(): number {
    return this.stretches.at(-1)?.end ?? -Infinity;
  }

  /** Number of the stretch that an instant lies in, or -1. */
  find(x: number): number {
    let [low, high] = [0, this.stretches.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.stretches[middle]!.begin <= x) low = middle + 1;
      else high = middle;
    }
    return low > 0 && x < this.stretches[low - 1]!.end ? low - 1 : -1;
  }
}

/** Decoded frames of a node, from which the picture of any instant in them is put together. */
export class Stretches {
  private readonly pages = new Map<number, Page>();

  /** @param most so many stretches of each page are kept */
  constructor(private readonly most: number) {}

  put(stretch: Stretch): void {
    let page = this.pages.get(stretch.page);
    if (page === undefined) {
      page = new Page();
      this.pages.set(stretch.page, page);
    }
    page.put(stretch);
    if (page.stretches.length > this.most) page.stretches.shift();
  }

  clear(): void {
    this.pages.clear();
  }

  /** Where the first stretch that is kept begins, or null without any. */
  get begin(): number | null {
    const begins = [...this.pages.values()].map(({ stretches }) => stretches[0]!.begin);
    return begins.length === 0 ? null : Math.min(...begins);
  }

  /** Where the newest stretch ends, or null without any. */
  get end(): number | null {
    return this.pages.size === 0 ? null : Math.max(...[...this.pages.values()].map(({ end }) => end));
  }

  /** How long the newest stretch is, in ns. */
  get length(): number {
    let newest: Stretch | undefined;
    for (const { stretches } of this.pages.values()) {
      const last = stretches.at(-1);
      if (last && (newest === undefined || last.end > newest.end)) newest = last;
    }
    return newest ? newest.end - newest.begin : 0;
  }

  /**
   * Up to which instant pictures are complete, or null without any. A page is not waited for when another one has
   * two stretches that it has not: it is missing.
   */
  get complete(): number | null {
    let newest: Page | null = null;
    for (const page of this.pages.values()) if (newest === null || page.end > newest.end) newest = page;
    if (newest === null) return null;
    const before = newest.stretches.at(-2)?.begin ?? -Infinity;
    let complete = newest.end;
    for (const page of this.pages.values()) if (page.end > before) complete = Math.min(complete, page.end);
    return complete;
  }

  /** Names the samples of an instant: where it is the same, so is the picture. */
  nameAt(x: number): string {
    let name = "";
    for (const [number, page] of this.pages) {
      const place = page.find(x);
      if (place < 0) continue;
      const stretch = page.stretches[place]!;
      name += `${number}:${stretch.begin}`;
      const periods = new Set<number>();
      for (const { grid } of stretch.patches.values()) {
        const period = grid.period + grid.delay;
        if (periods.has(period)) continue;
        periods.add(period);
        name += `,${rowAt(stretch, grid, x)}`;
      }
      name += ";";
    }
    return name;
  }

  /** Writes the newest bounds of each taxel; unknown where the frame of its page is missing. */
  readNewest(taxels: Taxels, picture: Picture): void {
    const { complete } = this;
    this.read(taxels, complete === null ? Number.NaN : complete - 1, picture);
  }

  /** Writes the bounds of each taxel at an instant; unknown where the frame of its page is missing. */
  read(skin: Taxels, x: number, picture: Picture): void {
    picture.newest = Number.NaN;
    for (const { number, page: pageNumber, first, columns } of skin.patches) {
      const page = this.pages.get(pageNumber);
      const place = page ? page.find(x) : -1;
      const stretch = place < 0 ? undefined : page!.stretches[place]!;
      const samples = stretch?.patches.get(number);
      if (!stretch || !samples || samples.sampling.columns !== columns) {
        picture.lo.fill(-Infinity, first, first + columns);
        picture.hi.fill(Infinity, first, first + columns);
        continue;
      }
      const row = rowAt(stretch, samples.grid, x);
      const sampled = stretch.origin + samples.grid.delay + row * samples.grid.period;
      if (!(sampled <= picture.newest)) picture.newest = sampled;
      if (samples.sampling.strides) {
        readStrided(page!.stretches, { place, row, number, first }, picture);
        continue;
      }
      const from = row * columns;
      const { lo, hi } = samples.samples;
      for (let column = 0; column < columns; column += 1) {
        picture.lo[first + column] = lo[from + column]!;
        picture.hi[first + column] = hi[from + column]!;
      }
    }
  }
}

function rowAt(stretch: Stretch, grid: PatchSamples["grid"], x: number): number {
  return Math.max(0, Math.min(grid.rows - 1, Math.floor((x - stretch.origin - grid.delay) / grid.period)));
}

interface Place {
  /** Number of the stretch, and of the row in it. */
  readonly place: number;
  readonly row: number;
  /** Number of the patch, and of its first column in the picture. */
  readonly number: number;
  readonly first: number;
}

/** Reads columns that are not sampled in each row: each keeps its last sample until the next one. */
function readStrided(stretches: readonly Stretch[], { place, row, number, first }: Place, picture: Picture): void {
  const { sampling, grid } = stretches[place]!.patches.get(number)!;
  const { columns, firstRow, strides } = sampling;
  for (let column = 0; column < columns; column += 1) {
    let held: PatchSamples | undefined = stretches[place]!.patches.get(number);
    let at = row - ((firstRow + row) % 2 ** strides![column]!);
    let due = grid.firstRow;
    for (let before = place - 1; at < 0 && held; before -= 1) {
      held = stretches[before]?.patches.get(number);
      // After a gap, or with another grid, nothing says what the last sample was.
      if (held?.sampling.columns !== columns || held.grid.firstRow + held.grid.rows !== due) held = undefined;
      else {
        at += held.grid.rows;
        due = held.grid.firstRow;
      }
    }
    const cell = at * columns + column;
    picture.lo[first + column] = held ? held.samples.lo[cell]! : -Infinity;
    picture.hi[first + column] = held ? held.samples.hi[cell]! : Infinity;
  }
}
