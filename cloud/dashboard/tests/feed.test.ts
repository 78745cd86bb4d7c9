import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { Feed, type StreamMessage } from "../src/live/feed";

beforeEach(() => {
  vi.stubGlobal("addEventListener", () => undefined);
  vi.stubGlobal("removeEventListener", () => undefined);
  vi.stubGlobal("navigator", { onLine: true });
});

afterEach(() => vi.unstubAllGlobals());

/** A feed of streams that say one text each and end; tells from where on each was asked for. */
function feedOf(texts: readonly string[], after: string | null = null): { feed: Feed; told: StreamMessage[]; asked: (string | null)[]; ended: Promise<void> } {
  const asked: (string | null)[] = [];
  const told: StreamMessage[] = [];
  const waiting = [...texts];
  const ends: (() => void)[] = [];
  const ended = new Promise<void>((resolve) => ends.push(resolve));
  const feed: Feed = new Feed({
    url: "/live",
    after,
    fetch: (_, options) => {
      asked.push(new Headers(options?.headers).get("Last-Event-ID"));
      const text = waiting.shift();
      if (text !== undefined) return Promise.resolve(new Response(text));
      feed.stop();
      ends[0]?.();
      return Promise.reject(new TypeError("away"));
    },
    random: () => 0.5,
    onMessage: (message) => told.push(message),
    onState: () => undefined,
    onUnauthorised: () => undefined,
  });
  return { feed, told, asked, ended };
}

describe("a live feed", () => {
  test("goes on where it broke off, also before the first message", async () => {
    const { feed, told, asked, ended } = feedOf(["retry: 1\nid: 41\n: connected\n\n", "id: 45\n: beat\n\nid: 46\ndata: cut off"]);
    feed.start();
    await ended;
    expect(asked).toEqual([null, "41", "45"]);
    expect([told, feed.cursor]).toEqual([[], "45"]);
  });

  test("goes on where another one is", async () => {
    const { feed, told, asked, ended } = feedOf(["retry: 1\nid: 8\ndata: x\n\n"], "7");
    expect(feed.cursor).toBe("7");
    feed.start();
    await ended;
    expect(asked).toEqual(["7", "8"]);
    expect(told.map(({ data }) => data)).toEqual(["x"]);
  });
});
