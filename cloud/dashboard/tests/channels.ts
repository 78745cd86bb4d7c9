import { Client } from "../src/api/client";
import type { ChannelItem, SeriesAnswer } from "../src/api/contract";
import { ChannelData } from "../src/live/channel-data";
import { LiveEdge } from "../src/live/edge";
import { Timeline } from "../src/time/timeline";
import { readSeries } from "../src/tube/decode";
import type { Entries } from "../src/tube/entries";

export const MS = 1_000_000;
export const ORIGIN = BigInt(Date.parse("2026-01-31T12:00:00Z")) * 1_000_000n;
export const SIGNAL = new AbortController().signal;

export function iso(ms: number): string {
  return `${new Date(Number(ORIGIN / 1_000_000n) + ms).toISOString().slice(0, -1)}000000Z`;
}

/** A series of samples from one instant to another (ms), one each ms. */
export function series(from: number, to: number): SeriesAnswer {
  const count = to - from;
  const t = Array.from({ length: count }, (_, i) => i * MS);
  const flat = { lo: t.map(() => 1), hi: t.map(() => 2), dt: MS, time_error: 0 };
  return { node: "n", channel: "c", unit: "F", coverage: 1, resolution: "sample", t0: iso(from), t, ...flat };
}

/** Samples of the live stream from one instant to another (ms), one each ms. */
export function run(from: number, to: number, answer: Partial<SeriesAnswer> = {}): Entries {
  return readSeries({ ...series(from, to), ...answer }, new Timeline(ORIGIN));
}

export function channel(end: number): ChannelItem {
  return {
    id: "c", taxel: "t", quantity: "c", unit: "F", coverage: 1, dt: MS,
    first: iso(0), last: iso(end - 1), biometric: false,
  };
}

/** A channel whose store answers with the samples of the given stretches. */
export function dataOf(item: ChannelItem, stored: readonly (readonly [number, number])[], resolution: "sample" | "hull" = "sample", edge = new LiveEdge()): ChannelData {
  const answer = (url: string): SeriesAnswer => {
    const query = new URL(url, "http://cloud").searchParams;
    const [start, end] = ["start", "end"].map((name) => Number(BigInt(query.get(name)!) - ORIGIN) / MS);
    const found = stored.map(([from, to]) => [Math.max(from, start!), Math.min(to, end!)] as const);
    const [from, to] = found.find(([one, other]) => other > one) ?? [start!, start!];
    return { ...series(from, to), resolution };
  };
  const client = new Client({
    fetch: (url) => Promise.resolve(Response.json(answer(String(url)))),
    onUnauthorised: () => undefined,
  });
  return new ChannelData({ client, timeline: new Timeline(ORIGIN), node: "n", channel: item, edge });
}
