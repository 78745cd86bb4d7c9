import { describe, expect, test } from "vitest";
import { Client } from "../src/api/client";
import { ChannelData } from "../src/live/channel-data";
import { LiveEdge } from "../src/live/edge";
import { Timeline } from "../src/time/timeline";
import { hullWithin } from "../src/tube/entries";
import { channel, MS, ORIGIN, run, series, SIGNAL } from "./channels";

/** A channel whose instants may be wrong by 30 ms, and what its store was asked for; of over 500 ms it answers with hulls. */
function doubtful(): { readonly data: ChannelData; readonly asked: string[] } {
  const asked: string[] = [];
  const client = new Client({
    fetch: (url) => {
      const query = new URL(String(url), "http://cloud").searchParams;
      const [from, to] = ["start", "end"].map((name) => Number(BigInt(query.get(name)!) - ORIGIN) / MS);
      asked.push(`${from} ${to}`);
      const stated = series(Math.max(0, from!), Math.min(1000, to!));
      const spike = 520 - Math.max(0, from!);
      return Promise.resolve(Response.json({ ...stated, resolution: to! - from! > 500 ? "hull" : "sample", time_error: 30 * MS, hi: stated.hi.map((hi, i) => (i === spike ? 9 : hi)) }));
    },
    onUnauthorised: () => undefined,
  });
  return { data: new ChannelData({ client, timeline: new Timeline(ORIGIN), node: "n", channel: channel(1000), edge: new LiveEdge() }), asked };
}

describe("a window of the past of doubtful instants", () => {
  test("takes in what may lie in it, wherever its instants are in their error of time", async () => {
    const { data, asked } = doubtful();
    await data.load({ x0: 500 * MS, x1: 510 * MS }, 500, SIGNAL);
    expect(hullWithin(data.history, 500 * MS, 510 * MS).hi).toBe(9);
    expect(asked).toEqual(["500 510", "470 540"]);
    expect([data.holds({ x0: 500 * MS, x1: 510 * MS }), data.holds({ x0: 500 * MS, x1: 511 * MS })]).toEqual([true, false]);
    await data.load({ x0: 600 * MS, x1: 610 * MS }, 500, SIGNAL);
    expect(asked.slice(2)).toEqual(["570 640"]);
  });

  test("is asked for once where the stream has stated the error", async () => {
    const { data, asked } = doubtful();
    data.take(run(1000, 1050, { time_error: 30 * MS }), 0, null);
    await data.load({ x0: 600 * MS, x1: 610 * MS }, 500, SIGNAL);
    expect(asked).toEqual(["570 640"]);
  });

  test("is asked for again where the stream states the error while the store is asked", async () => {
    const { data, asked } = doubtful();
    const loading = data.load({ x0: 500 * MS, x1: 510 * MS }, 500, SIGNAL);
    data.take(run(1000, 1050, { time_error: 30 * MS }), 0, null);
    await loading;
    expect(asked).toEqual(["500 510", "470 540"]);
    expect(hullWithin(data.history, 500 * MS, 510 * MS).hi).toBe(9);
  });

  test("is asked for as narrowly as its own instants let it be, however wrong the stream's were", async () => {
    const { data, asked } = doubtful();
    data.take(run(1000, 1050, { time_error: 3_600_000 * MS }), 0, null);
    await data.load({ x0: 500 * MS, x1: 510 * MS }, 500, SIGNAL);
    expect(asked).toEqual(["-3599500 3600510", "470 540"]);
    expect(data.resolution).toBe("sample");
    await data.load({ x0: 600 * MS, x1: 610 * MS }, 500, SIGNAL);
    expect(asked.slice(2)).toEqual(["570 640"]);
  });
});
