import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { FrameError } from "../src/frames/frame-error";
import { FrameFeed, type LiveMessage, readLiveMessage } from "../src/live/frame-feed";
import { ContactTrack, type ContactsAt, describeContacts, forceText } from "../src/skin/contacts";
import { Film, PICTURES } from "../src/skin/film";
import { Timeline } from "../src/time/timeline";

/** Writes an array of CBOR: texts, byte strings, small numbers and null. */
function message(...items: (string | Uint8Array | number | null)[]): Uint8Array {
  const out = [0x80 | items.length];
  for (const item of items) {
    if (item === null) out.push(0xf6);
    else if (typeof item === "number") {
      const long = new DataView(new ArrayBuffer(8));
      long.setBigUint64(0, BigInt(item));
      out.push(0x1b, ...new Uint8Array(long.buffer));
    } else {
      const data = typeof item === "string" ? new TextEncoder().encode(item) : item;
      out.push((typeof item === "string" ? 0x60 : 0x40) | 25, data.length >> 8, data.length & 255, ...data);
    }
  }
  return Uint8Array.from(out);
}

describe("messages of the live WebSocket", () => {
  test("are read by their kind; what is not known is left out", () => {
    expect(readLiveMessage(message("layout", "hand", Uint8Array.of(1, 0xab)))).toEqual({ kind: "layout", node: "hand", layout: "01ab" });
    expect(readLiveMessage(message("frame", "c1", "hand", 7, Uint8Array.of(9)))).toEqual({ kind: "frame", cursor: "c1", node: "hand", received: 7, frame: Uint8Array.of(9) });
    expect(readLiveMessage(message("event", "c2", "peak", "{}"))).toEqual({ kind: "event", cursor: "c2", event: "peak", json: "{}" });
    expect(readLiveMessage(message("lagging", "c3", 4))).toEqual({ kind: "lagging", cursor: "c3", skipped: 4 });
    expect(readLiveMessage(message("lagging", "c4", null))).toEqual({ kind: "lagging", cursor: "c4", skipped: null });
    expect(readLiveMessage(message("tomorrow", "c4"))).toBeNull();
  });

  test("of another form are refused", () => {
    expect(() => readLiveMessage(message("frame", "c1", 7, 7, 7))).toThrow(FrameError);
    expect(() => readLiveMessage(Uint8Array.of(0x01))).toThrow(FrameError);
    expect(() => readLiveMessage(message("lagging", "c3", 4).slice(0, -1))).toThrow(FrameError);
  });
});

/** A WebSocket that a test opens, feeds and closes. */
class FakeSocket extends EventTarget {
  static readonly OPEN = 1;
  static all: FakeSocket[] = [];
  readyState = 0;
  readonly sent: string[] = [];

  constructor(readonly url: URL) {
    super();
    FakeSocket.all.push(this);
  }

  open(): void {
    this.readyState = FakeSocket.OPEN;
    this.dispatchEvent(new Event("open"));
  }

  give(data: Uint8Array): void {
    this.dispatchEvent(Object.assign(new Event("message"), { data: data.slice().buffer }));
  }

  send(text: string): void {
    this.sent.push(text);
  }

  close(code = 1000): void {
    if (this.readyState === 3) return;
    this.readyState = 3;
    this.dispatchEvent(Object.assign(new Event("close"), { code, reason: "" }));
  }
}

beforeEach(() => {
  vi.useFakeTimers();
  FakeSocket.all = [];
  vi.stubGlobal("WebSocket", FakeSocket);
  vi.stubGlobal("location", { href: "https://cloud.test/" });
  vi.stubGlobal("navigator", { onLine: true });
  vi.stubGlobal("addEventListener", () => undefined);
  vi.stubGlobal("removeEventListener", () => undefined);
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

function start(): {
  feed: FrameFeed; got: LiveMessage[]; states: string[]; unreadable: () => number; replaced: () => number;
} {
  const [got, states]: [LiveMessage[], string[]] = [[], []];
  let [refused, replaced] = [0, 0];
  const feed = new FrameFeed({
    url: (nodes, cursor) => `/api/v1/live?node=${nodes.join("&node=")}${cursor === null ? "" : `&cursor=${cursor}`}`,
    onMessage: (one) => got.push(one),
    onUnreadable: () => (refused += 1),
    onState: ({ kind }) => states.push(kind),
    onReplaced: () => (replaced += 1),
  }, { nodes: ["hand"], patches: null });
  feed.start();
  return { feed, got, states, unreadable: () => refused, replaced: () => replaced };
}

describe("the feed of frames", () => {
  test("resumes after the last message when the connection breaks", () => {
    const { feed, got, states } = start();
    const [first] = FakeSocket.all;
    expect(String(first!.url)).toBe("wss://cloud.test/api/v1/live?node=hand");
    first!.open();
    first!.give(message("lagging", "c7", 0));
    first!.close();
    expect(states).toEqual(["connecting", "open", "waiting"]);
    vi.advanceTimersByTime(1_000);
    expect(String(FakeSocket.all[1]!.url)).toContain("cursor=c7");
    expect(got.length).toBe(1);
    feed.stop();
  });

  test("gives up a connection over which nothing comes", () => {
    const { feed, states } = start();
    FakeSocket.all[0]!.open();
    vi.advanceTimersByTime(29_000);
    FakeSocket.all[0]!.give(message("lagging", "c1", 0));
    vi.advanceTimersByTime(29_000);
    expect(states.at(-1)).toBe("open");
    vi.advanceTimersByTime(2_000);
    expect(states).toContain("waiting");
    feed.stop();
  });

  test("counts what cannot be read, and goes on", () => {
    vi.spyOn(console, "warn").mockImplementation(() => undefined);
    const { feed, got, unreadable } = start();
    FakeSocket.all[0]!.open();
    FakeSocket.all[0]!.give(Uint8Array.of(0xff));
    FakeSocket.all[0]!.give(message("lagging", "c1", 3));
    expect([unreadable(), got.length]).toEqual([1, 1]);
    feed.stop();
  });

  test("says which patches it wants, also after the connection was opened again", () => {
    const { feed } = start();
    FakeSocket.all[0]!.open();
    feed.choose({ nodes: ["hand"], patches: ["p3"] });
    FakeSocket.all[0]!.close();
    vi.advanceTimersByTime(1_000);
    FakeSocket.all[1]!.open();
    for (const socket of FakeSocket.all) expect(socket.sent.map((text) => JSON.parse(text) as unknown)).toEqual([{ nodes: ["hand"], patches: ["p3"] }]);
    feed.stop();
    vi.advanceTimersByTime(60_000);
    expect(FakeSocket.all.length).toBe(2);
  });
});

function contact(force: [number | null, number | null]): ContactsAt["cores"][number] {
  return { cells: [3, 5], area: [3e-6, 5e-6], force, centroid: [[0, 0], [0, 0]], taxels: [] };
}

test("the feed asks for other nodes over the same connection, and after a break for those alone", () => {
  const { feed } = start();
  FakeSocket.all[0]!.open();
  const selection = { nodes: ["hand", "palm"], patches: null };
  feed.choose(selection);
  feed.choose({ ...selection });
  expect(FakeSocket.all[0]!.sent.map((text) => JSON.parse(text) as unknown)).toEqual([selection]);
  FakeSocket.all[0]!.close();
  vi.advanceTimersByTime(1_000);
  FakeSocket.all[1]!.open();
  expect(FakeSocket.all[1]!.url.searchParams.getAll("node")).toEqual(["hand", "palm"]);
  expect(FakeSocket.all[1]!.sent).toEqual([]);
  feed.stop();
});

describe("contacts in words", () => {
  test("enclose what is known", () => {
    expect(describeContacts(null)).toBe("No contact.");
    expect(describeContacts({ x: 0, cores: [], regions: [{ contacts: [0, 2], taxels: [] }] })).toBe("0 to 2 contacts, none of them certain.");
    expect(describeContacts({ x: 0, cores: [contact([1.2, 1.6])], regions: [{ contacts: [1, 1], taxels: [] }] })).toBe("1 contact: 1.20 to 1.60 N.");
    expect(forceText(contact([4.2, null]))).toBe("≥ 4.2000 N");
  });

  test("the statement nearest to an instant holds, within its reach", () => {
    const track = new ContactTrack(3);
    for (const x of [300, 100, 200, 400]) track.put({ x, cores: [], regions: [] });
    expect(track.all.map(({ x }) => x)).toEqual([200, 300, 400]);
    expect(track.at(240, 50)?.x).toBe(200);
    expect(track.at(500, 50)).toBeNull();
  });
});

const asked: { x0: number; x1: number; signal: AbortSignal }[] = [];
let now = 0;
let failing = false;

function film(): Film {
  asked.length = 0;
  return new Film({
    timeline: new Timeline(0n),
    ask: (range, points, signal) => {
      expect(points).toBe(PICTURES);
      asked.push({ ...range, signal });
      return failing ? Promise.reject(new Error("away")) : Promise.resolve(new Uint8Array());
    },
    onLoaded: () => undefined,
    onFailure: () => undefined,
    now: () => now,
    present: () => 1e12,
  });
}

const step = 2 ** 25;
const length = step * PICTURES;

describe("the film", () => {
  test("asks once for what is around a position, and has it then", async () => {
    const reels = film();
    for (let k = 0; k < 5; k += 1) reels.want([{ x: 10 * length + k, step: step - k }]);
    expect(asked.map(({ x0, x1 }) => [x0, x1])).toEqual([[10 * length, 11 * length]]);
    expect(reels.at(10.5 * length)).toBeNull();
    await vi.advanceTimersByTimeAsync(0);
    expect(reels.at(10.5 * length)?.step).toBe(step);
    reels.want([{ x: 10 * length, step }]);
    expect(asked.length).toBe(1);
  });

  test("drops what is no longer needed", () => {
    const reels = film();
    reels.want([{ x: 0, step }]);
    reels.want([{ x: 5 * length, step }]);
    expect(asked.map(({ signal }) => signal.aborted)).toEqual([true, false]);
  });

  test("asks again later for what the store was still receiving, and after a failure", async () => {
    const reels = film();
    const open = Math.floor(1e12 / length) * length;
    reels.want([{ x: open, step }]);
    await vi.advanceTimersByTimeAsync(0);
    now += 1_000;
    reels.want([{ x: open, step }]);
    expect(asked.length).toBe(1);
    now += 2_000;
    failing = true;
    reels.want([{ x: open, step }]);
    expect(asked.length).toBe(2);
    await vi.advanceTimersByTimeAsync(0);
    reels.want([{ x: open, step }]);
    expect(asked.length).toBe(2);
    now += 3_000;
    failing = false;
    reels.want([{ x: open, step }]);
    expect(asked.length).toBe(3);
  });
});

describe("the feed of frames of a store that was replaced", () => {
  test("ends where the store was replaced by another", () => {
    const { states, replaced } = start();
    FakeSocket.all[0]!.open();
    FakeSocket.all[0]!.give(message("lagging", "c7", 0));
    FakeSocket.all[0]!.close(1012);
    vi.advanceTimersByTime(1_000);
    expect([replaced(), states.at(-1)]).toEqual([0, "connecting"]);
    FakeSocket.all[1]!.open();
    FakeSocket.all[1]!.close(4422);
    vi.advanceTimersByTime(60_000);
    expect([replaced(), FakeSocket.all.length]).toEqual([1, 2]);
  });
});
