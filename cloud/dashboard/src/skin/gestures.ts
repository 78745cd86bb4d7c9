import type { GestureItem } from "../api/contract";
import type { Range } from "../state/window";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";

type Bounds = readonly [number | null, number | null];

/** A place on the map, in m. */
export type Point = readonly [number, number];

/** Where a touch begins and ends: the middles of what encloses it; null where nothing is known. */
export interface Way {
  readonly begin: Point | null;
  readonly end: Point | null;
}

/** What one touch, or two, make: one gesture for certain, or one of some kinds possibly. */
export interface GestureMark {
  readonly kinds: readonly string[];
  readonly verdict: GestureItem["verdict"];
  /** From its earliest to its latest instant, in ns of the timeline; of what the window cuts, from or to there. */
  readonly begin: number;
  readonly end: number;
  readonly cutsBegin: boolean;
  readonly cutsEnd: boolean;
  /** Whether its touches are certain, whatever they make. */
  readonly touched: boolean;
  /** How many there are at most: touches that may be none at all, and are beside one another in time, are one mark. */
  readonly most: number;
  /** The direction of a slide or a swipe in rad, if it is known to an eighth of a turn; else null. */
  readonly direction: number | null;
  readonly ways: readonly Way[];
}

/** A wider enclosure has no arrow: it would name a direction that may be wrong. */
const WIDEST = Math.PI / 4;
const ARROWS = ["→", "↗", "↑", "↖", "←", "↙", "↓", "↘"] as const;
/** A label names so many kinds at most. */
const MOST_KINDS = 2;
/** Touches that may be none, no farther apart in time (ns), are one mark. */
const APART = 1e8;
/** Live, so long a window is asked for (ns): most gestures are shorter, and each second is computed anew. */
const USUAL = 3e9;
/** A window that begins so long before a touch (ns) does not cut it. */
const BEFORE = 2e8;
/** A window that is no longer than this is asked for as a whole, in ns. */
const LONGEST = 10e9;
/** Of a longer one, the part around the position. */
const PART = 2e9;
/** What is asked for reaches so far beyond what is shown, so that the cut is not seen. */
const MARGIN = 1e9;

function pointOf([x, y]: readonly Bounds[]): Point | null {
  const middle = (bounds: Bounds | undefined): number | null => {
    const [lo, hi] = bounds ?? [0, 0];
    return lo === null || hi === null ? null : (lo + hi) / 2;
  };
  const found = [middle(x), middle(y)] as const;
  return found[0] === null || found[1] === null ? null : [found[0], found[1]];
}

function directionOf({ direction }: GestureItem): number | null {
  const { lo, hi } = direction ?? { lo: null, hi: null };
  return lo === null || hi === null || hi - lo > WIDEST ? null : (lo + hi) / 2;
}

function markOf(item: GestureItem, window: Range, timeline: Timeline): GestureMark {
  const { begin, end, verdict, places } = item;
  return {
    kinds: [item.kind],
    verdict,
    begin: begin.lo === null ? window.x0 : timeline.toX(parseInstant(begin.lo)),
    end: end.hi === null ? window.x1 : timeline.toX(parseInstant(end.hi)),
    cutsBegin: begin.lo === null,
    cutsEnd: end.hi === null,
    touched: item.contacts.length > 0,
    most: 1,
    direction: directionOf(item),
    ways: places.map((place) => ({ begin: pointOf(place.begin), end: pointOf(place.end) })),
  };
}

/** Unites marks of the same kinds of touches that may be none: where the skin is pressed lightly, there are many. */
function unite(marks: readonly GestureMark[]): GestureMark[] {
  const united: GestureMark[] = [];
  for (const mark of marks.toSorted((one, other) => one.begin - other.begin)) {
    const kinds = mark.kinds.join();
    const same = united.findIndex((one) => one.kinds.join() === kinds && mark.begin <= one.end + APART);
    const before = united[same];
    if (before === undefined) united.push(mark);
    else {
      united[same] = {
        ...before,
        end: Math.max(before.end, mark.end),
        cutsBegin: before.cutsBegin || mark.cutsBegin,
        cutsEnd: before.cutsEnd || mark.cutsEnd,
        most: before.most + 1,
        direction: null,
        ways: [...before.ways, ...mark.ways],
      };
    }
  }
  return united;
}

/** Collects the gestures of a window: what one touch may be is one mark. */
export function marksOf(items: readonly GestureItem[], window: Range, timeline: Timeline): GestureMark[] {
  const found = new Map<string, GestureMark>();
  for (const item of items) {
    const mark = markOf(item, window, timeline);
    const key = JSON.stringify([item.verdict, item.begin, item.end, item.contacts, item.places]);
    const same = found.get(key);
    const direction = same?.direction ?? mark.direction;
    found.set(key, same === undefined ? mark : { ...same, kinds: [...same.kinds, ...mark.kinds], direction });
  }
  const marks = [...found.values()];
  return [...marks.filter(({ touched }) => touched), ...unite(marks.filter(({ touched }) => !touched))];
}

/** Names the kinds of a mark, with an arrow where the direction is known. */
export function kindText({ kinds, direction, most }: GestureMark): string {
  const last = kinds.at(-1) ?? "";
  const many = most > 1 ? `, up to ${most}` : "";
  const names = kinds.length > 1 ? `${kinds.slice(0, -1).join(", ")} or ${last}` : last;
  const turn = direction === null ? null : Math.round(direction / (Math.PI / 4));
  return turn === null ? `${names}${many}` : `${names} ${ARROWS[((turn % 8) + 8) % 8]}`;
}

/** What is written beside a mark on the skin. */
export function labelText(mark: GestureMark): string {
  if (mark.verdict === "certain") return kindText(mark);
  return mark.kinds.length > MOST_KINDS ? "possible gesture" : `possible ${kindText(mark)}`;
}

/** Where the label of a mark is: in the middle of where its touches end, or begin. */
export function placeOfLabel({ ways }: GestureMark): Point | null {
  const points = ways.map(({ begin, end }) => end ?? begin).filter((point) => point !== null);
  if (points.length === 0) return null;
  const mean = (axis: 0 | 1): number => points.reduce((sum, point) => sum + point[axis], 0) / points.length;
  return [mean(0), mean(1)];
}

/** The window of which gestures are asked for, where a window of the past is shown at a position. */
export function askedOf(range: Range, position: number): Range {
  if (range.x1 - range.x0 <= LONGEST) return { x0: range.x0 - MARGIN, x1: range.x1 + MARGIN };
  const first = Math.floor(position / PART) * PART;
  return { x0: first - MARGIN, x1: first + PART + MARGIN };
}

/**
 * The window of which gestures are asked for live: the last seconds, and as far back as a touch began that goes on.
 *
 * @param since when that touch began; null: none goes on
 */
export function askedLive(end: number, since: number | null): Range {
  const usual = end - USUAL;
  return { x0: since === null ? usual : Math.max(end - LONGEST, Math.min(usual, since - BEFORE)), x1: end };
}

/** Gestures over time, as windows that overlap state them. */
export class GestureLog {
  private found: GestureMark[] = [];

  /** @param most so many are kept */
  constructor(private readonly most: number) {}

  /** Takes what a window states: all that was known of it is replaced, and what it cuts is left to others. */
  put(window: Range, marks: readonly GestureMark[]): void {
    const within = (x: number): boolean => x >= window.x0 && x <= window.x1;
    const kept = this.found.filter(({ begin, end, cutsBegin, cutsEnd }) => {
      const known = within(begin) && within(end);
      // What was cut, and lies here further on, is seen whole now, or is stated anew.
      return !known && !(cutsEnd && within(end)) && !(cutsBegin && within(begin));
    });
    const fresh = marks.filter(({ begin, end, cutsBegin, cutsEnd }) => {
      const whole = (one: GestureMark): boolean => (cutsBegin && one.end === end) || (cutsEnd && one.begin === begin);
      return !kept.some(whole);
    });
    this.found = [...kept, ...fresh].toSorted((one, other) => one.end - other.end).slice(-this.most);
  }

  clear(): void {
    this.found = [];
  }

  /**
   * What is shown at an instant: gestures that have begun, until so long (ns) after their ends. Certain ones come first,
   * then those of certain touches, each the latest first.
   */
  at(x: number, linger: number): GestureMark[] {
    const shown = this.found.filter(({ begin, end }) => begin <= x && x <= end + linger);
    const rank = ({ verdict, touched }: GestureMark): number => (verdict === "certain" ? 2 : Number(touched));
    return shown.toSorted((one, other) => rank(other) - rank(one) || other.end - one.end);
  }

  /** The latest gestures that have begun by an instant, the latest first. */
  latest(x: number, most: number): GestureMark[] {
    return this.found.filter(({ begin }) => begin <= x).slice(-most).toReversed();
  }
}
