import { describe, expect, test } from "vitest";
import { Client } from "../src/api/client";
import { Backfill } from "../src/live/backfill";
import { ChannelData } from "../src/live/channel-data";
import { LiveEdge } from "../src/live/edge";
import { Timeline } from "../src/time/timeline";
import { channel, iso, MS, ORIGIN, run, series } from "./channels";

const SPAN = 1000 * MS;

function hole(from: number, to: number): { x0: number; x1: number } {
  return { x0: from * MS, x1: to * MS };
}

/** A backfill, what it says, and a cloud that answers its questions when it is notified to. */
function slowly(): { backfill: Backfill; said: string[]; answers: ((answer: Response) => Promise<void>)[] } {
  const said: string[] = [];
  const answers: ((answer: Response) => Promise<void>)[] = [];
  const fetch = (): Promise<Response> => new Promise((resolve) => {
    answers.push((answer) => {
      resolve(answer);
      return new Promise((done) => { setTimeout(done, 10); });
    });
  });
  const client = new Client({ fetch, onUnauthorised: () => undefined });
  const edge = new LiveEdge();
  const data = new ChannelData({ client, timeline: new Timeline(ORIGIN), node: "n", channel: channel(1000), edge });
  const backfill = new Backfill({ data, edge, width: () => 100, onFilled: () => said.push("filled"), onFailure: () => said.push("failed") });
  return { backfill, said, answers };
}

/** The time range that each request asks for, in ms. */
function asked(urls: readonly string[]): (readonly [number, number])[] {
  return urls.map((url) => {
    const query = new URL(url, "http://cloud").searchParams;
    const [start, end] = ["start", "end"].map((name) => Number(BigInt(query.get(name)!) - ORIGIN) / MS);
    return [start!, end!] as const;
  });
}

function away(): Response {
  return new Response("", { status: 503 });
}

describe("filling a live window", () => {
  test("is not done by one stretch that came, where another one did not", async () => {
    const { backfill, said, answers } = slowly();
    backfill.fillHole(hole(100, 200), SPAN);
    backfill.fillHole(hole(300, 400), SPAN);
    await answers[0]!(away());
    await answers[1]!(Response.json(series(300, 400)));
    expect(said).toEqual(["failed"]);
    backfill.fillHole(hole(500, 600), SPAN);
    expect(answers.length).toBe(2);
  });

  test("asks for what is missing behind the window that it asks for again", async () => {
    const { backfill, said, answers } = slowly();
    backfill.fillWindow(SPAN);
    await answers[0]!(away());
    backfill.fillWindow(SPAN);
    backfill.fillHole(hole(1100, 1200), SPAN);
    expect(answers.length).toBe(3);
    await answers[1]!(Response.json(series(0, 1000)));
    await answers[2]!(Response.json(series(1100, 1200)));
    expect(said).toEqual(["failed", "filled", "filled"]);
  });

  test("says no more once it was given up", async () => {
    const { backfill, said, answers } = slowly();
    backfill.fillWindow(SPAN);
    backfill.fillHole(hole(100, 200), SPAN);
    backfill.stop();
    await answers[0]!(away());
    await answers[1]!(Response.json(series(100, 200)));
    expect(said).toEqual([]);
  });
});

const STORED = 70_000;
const STATED = 120_000;

/** A biometric channel with data up to STORED, of which the store states the minute alone. */
function biometric(): { data: ChannelData; edge: LiveEdge; backfill: Backfill; urls: string[]; filled: Promise<void> } {
  const urls: string[] = [];
  const fetch = (url: string): Promise<Response> => {
    urls.push(url);
    const { t, lo, hi, ...others } = series(STORED - 5000, STORED);
    // The store states that it has nothing after the last sample.
    const gap = { t: [...t, t.at(-1)! + MS], lo: [...lo, null], hi: [...hi, null] };
    return Promise.resolve(Response.json({ ...others, ...gap }));
  };
  const client = new Client({ fetch: (url) => fetch(String(url)), onUnauthorised: () => undefined });
  const edge = new LiveEdge();
  const item = { ...channel(0), last: iso(STATED), dt: null, biometric: true };
  const data = new ChannelData({ client, timeline: new Timeline(ORIGIN), node: "n", channel: item, edge });
  let backfill!: Backfill;
  const filled = new Promise<void>((resolve) => {
    backfill = new Backfill({ data, edge, width: () => 100, onFilled: resolve, onFailure: () => undefined });
  });
  return { data, edge, backfill, urls, filled };
}

describe("the live window of a biometric channel, whose end is known to the minute", () => {
  test("ends where its data end, not in the future", async () => {
    const { data, edge, backfill, urls, filled } = biometric();
    backfill.fillWindow(SPAN);
    await filled;
    expect(asked(urls)).toEqual([[STATED - 60_000 - SPAN / MS, STATED]]);
    const end = (STORED - 1) * MS + 1;
    expect(edge.newest()).toBe(end);
    expect(data.end).toBe(end);
    expect(data.extent?.x1).toBe(end);
    data.take(run(STORED, STORED + 100), 0, 1);
    expect(data.rolling.lo.every((lo) => !Number.isNaN(lo))).toBe(true);
  });

  test("ends there also where the stream was faster than the store", async () => {
    const { data, backfill, filled } = biometric();
    backfill.fillWindow(SPAN);
    data.take(run(STORED, STORED + 100), 0, 1);
    await filled;
    data.take(run(STORED + 100, STORED + 200), 0, 1);
    expect(data.end).toBe((STORED + 200) * MS);
    expect(data.rolling.lo.every((lo) => !Number.isNaN(lo))).toBe(true);
  });

  test("asks for the rest of the minute once the stream goes on", () => {
    const { data, edge } = biometric();
    expect(data.extent?.x1).toBe(STATED * MS);
    const { hole: missing } = data.take(run(75_000, 75_100), 0, 1);
    expect(missing).toEqual(hole(STATED - 60_000, 75_000));
    expect(edge.newest()).toBe(75_099 * MS);
    expect(data.end).toBe(75_100 * MS);
  });
});
