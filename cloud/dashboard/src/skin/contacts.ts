import type { ContactsItem, CoreItem } from "../api/contract";
import { formatCount, formatInterval } from "../interval/format";
import type { Interval } from "../interval/interval";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";

type Bounds = readonly [number | null, number | null];

export interface ContactsAt {
  /** When, in ns of the timeline. */
  readonly x: number;
  readonly cores: readonly CoreItem[];
  readonly regions: ContactsItem["regions"];
}

export function contactsAt(document: ContactsItem, timeline: Timeline): ContactsAt {
  return { x: timeline.toX(parseInstant(document.t)), cores: document.cores, regions: document.regions };
}

/** Reads a pair of bounds, of which null is an unbounded one. */
export function boundsOf([lo, hi]: Bounds): Interval {
  return { lo: lo ?? -Infinity, hi: hi ?? Infinity };
}

/** Fewest and most contacts on the whole skin. */
export function totalOf({ regions }: Pick<ContactsAt, "regions">): Interval {
  return regions.reduce<Interval>(
    (sum, { contacts }) => ({ lo: sum.lo + (contacts[0] ?? 0), hi: sum.hi + (contacts[1] ?? Infinity) }),
    { lo: 0, hi: 0 },
  );
}

/** The force of a contact in words that enclose it. */
export function forceText({ force }: Pick<CoreItem, "force">): string {
  return formatInterval(boundsOf(force), "N");
}

/** Says the contacts of an instant in words; null means that none is stated. */
export function describeContacts(found: ContactsAt | null): string {
  if (found === null) return "No contact.";
  const total = totalOf(found);
  if (total.hi === 0) return "No contact.";
  const noun = total.hi === 1 ? "contact" : "contacts";
  const forces = found.cores.map((core) => forceText(core).replace("–", " to ").replace("≥", "at least").replace("≤", "at most"));
  const named = forces.slice(0, MOST_WORDS).join(", ");
  const more = forces.length > MOST_WORDS ? ` and ${forces.length - MOST_WORDS} more` : "";
  return `${formatCount(total).replace("–", " to ")} ${noun}${named ? `: ${named}${more}` : ", none of them certain"}.`;
}

const MOST_WORDS = 4;

/** Contacts over time, of which the statement that holds at an instant is found. */
export class ContactTrack {
  private readonly found: ContactsAt[] = [];

  /** @param most so many statements are kept */
  constructor(private readonly most: number) {}

  put(one: ContactsAt): void {
    const { found } = this;
    let place = found.length;
    while (place > 0 && found[place - 1]!.x > one.x) place -= 1;
    if (found[place - 1]?.x === one.x) found[place - 1] = one;
    else found.splice(place, 0, one);
    if (found.length > this.most) found.shift();
  }

  get all(): readonly ContactsAt[] {
    return this.found;
  }

  /** The statement nearest to an instant, if it is no farther away than this (ns). */
  at(x: number, reach: number): ContactsAt | null {
    let nearest: ContactsAt | null = null;
    for (const one of this.found) {
      const distance = Math.abs(one.x - x);
      if (distance <= reach && !(nearest && Math.abs(nearest.x - x) <= distance)) nearest = one;
    }
    return nearest;
  }
}
