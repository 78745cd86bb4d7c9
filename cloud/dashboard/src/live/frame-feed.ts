import { messageOf } from "../api/error";
import { type Cbor, readCbor } from "../frames/cbor";
import { FrameError } from "../frames/frame-error";

export type FeedState =
  | { readonly kind: "connecting" }
  | { readonly kind: "open" }
  | { readonly kind: "waiting"; readonly seconds: number; readonly reason: string }
  | { readonly kind: "offline" };

/** One message of the live WebSocket (docs/rest.md). `skipped` is null where frames are missing, and their number is not known. */
export type LiveMessage =
  | { readonly kind: "layout"; readonly node: string; readonly layout: string }
  | { readonly kind: "frame"; readonly cursor: string; readonly node: string; readonly received: number; readonly frame: Uint8Array }
  | { readonly kind: "event"; readonly cursor: string; readonly event: string; readonly json: string }
  | { readonly kind: "contacts"; readonly cursor: string; readonly node: string; readonly json: string }
  | { readonly kind: "lagging"; readonly cursor: string; readonly skipped: number | null };

function text(value: Cbor | undefined): string {
  if (typeof value !== "string") throw new FrameError(`${String(value)} is no text`);
  return value;
}

function octets(value: Cbor | undefined): Uint8Array {
  if (!(value instanceof Uint8Array)) throw new FrameError(`${String(value)} is no byte string`);
  return value;
}

/** Writes bytes in hexadecimal. */
export function hex(data: Uint8Array): string {
  return Array.from(data, (octet) => octet.toString(16).padStart(2, "0")).join("");
}

/** Reads a message; null for one of a kind that this page does not know. */
export function readLiveMessage(data: Uint8Array): LiveMessage | null {
  const items = readCbor(data);
  if (!Array.isArray(items)) throw new FrameError("a live message is no array");
  const [kind, first, second, third, fourth] = items as readonly Cbor[];
  switch (kind) {
    case "layout":
      return { kind, node: text(first), layout: hex(octets(second)) };
    case "frame":
      return { kind, cursor: text(first), node: text(second), received: Number(third), frame: octets(fourth) };
    case "event":
      return { kind, cursor: text(first), event: text(second), json: text(third) };
    case "contacts":
      return { kind, cursor: text(first), node: text(second), json: text(third) };
    case "lagging":
      return { kind, cursor: text(first), skipped: second === null ? null : Number(second) };
    default:
      return null;
  }
}

/** What is asked for. */
export interface Selection {
  readonly nodes: readonly string[];
  /** The patches whose samples are wanted; null: all. */
  readonly patches: readonly string[] | null;
}

export interface FrameFeedOptions {
  /** Makes the address of the stream of these nodes, given where to resume. */
  readonly url: (nodes: readonly string[], cursor: string | null) => string;
  readonly onMessage: (message: LiveMessage) => void;
  /** A message could not be read. */
  readonly onUnreadable: () => void;
  readonly onState: (state: FeedState) => void;
  /** The cloud's store is another one than that of what was received. */
  readonly onReplaced: () => void;
}

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 15_000;
/** The cloud states every 10 s that it is there; three missing ones mean a dead connection. */
const SILENCE_MS = 30_000;
/** With which the cloud closes a stream whose cursor is not of its store. */
const UNKNOWN_CURSOR = 4422;
/** A connection that lasted so long was a good one: the next wait is short again. */
const GOOD_MS = 5_000;

/** Frames, contacts and events of some nodes as they are stored, over a WebSocket that is opened again when it closes. */
export class FrameFeed {
  private socket: WebSocket | null = null;
  private cursor: string | null = null;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private waitMs = FIRST_WAIT_MS;
  private openedAt = 0;
  private stopped = false;
  private selection: Selection;
  private watchdog: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: FrameFeedOptions, selection: Selection) {
    this.selection = selection;
  }

  start(): void {
    addEventListener("online", this.onOnline);
    addEventListener("offline", this.onOffline);
    this.connect();
  }

  /** Asks for something else. */
  choose(selection: Selection): void {
    if (JSON.stringify(selection) === JSON.stringify(this.selection)) return;
    this.selection = selection;
    if (this.socket?.readyState === WebSocket.OPEN) this.select();
  }

  stop(): void {
    this.stopped = true;
    if (this.watchdog !== null) clearTimeout(this.watchdog);
    removeEventListener("online", this.onOnline);
    removeEventListener("offline", this.onOffline);
    if (this.timer !== null) clearTimeout(this.timer);
    this.socket?.close();
  }

  private readonly onOnline = (): void => {
    this.waitMs = FIRST_WAIT_MS;
    this.connect();
  };

  private readonly onOffline = (): void => {
    this.socket?.close();
    this.options.onState({ kind: "offline" });
  };

  private connect(): void {
    if (this.stopped) return;
    if (this.timer !== null) clearTimeout(this.timer);
    this.socket?.close();
    const { onState, url } = this.options;
    onState({ kind: "connecting" });
    const address = new URL(url(this.selection.nodes, this.cursor), location.href);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => {
      if (socket !== this.socket) return;
      this.openedAt = performance.now();
      if (this.selection.patches !== null) this.select();
      this.watch();
      onState({ kind: "open" });
    });
    socket.addEventListener("message", ({ data }: MessageEvent<ArrayBuffer | string>) => {
      if (socket === this.socket && typeof data !== "string") this.take(new Uint8Array(data));
    });
    socket.addEventListener("close", ({ code, reason }) => {
      if (socket !== this.socket || this.stopped) return;
      if (code === UNKNOWN_CURSOR) {
        this.stop();
        this.options.onReplaced();
      } else {
        this.retryLater(reason || "the cloud closed the live stream");
      }
    });
  }

  /** Says which nodes and patches are wanted. */
  private select(): void {
    this.socket?.send(JSON.stringify(this.selection));
  }

  /** Gives the connection up when nothing comes over it. */
  private watch(): void {
    if (this.watchdog !== null) clearTimeout(this.watchdog);
    this.watchdog = setTimeout(() => {
      const { socket } = this;
      // A dead connection may take minutes to say that it is closed.
      if (socket?.readyState === WebSocket.OPEN) this.retryLater("no data for 30 s");
      socket?.close();
    }, SILENCE_MS);
  }

  private take(data: Uint8Array): void {
    this.watch();
    try {
      const message = readLiveMessage(data);
      if (message === null) return;
      if ("cursor" in message) this.cursor = message.cursor;
      this.options.onMessage(message);
    } catch (error) {
      if (!(error instanceof FrameError || error instanceof SyntaxError || error instanceof RangeError)) throw error;
      console.warn(`live message refused: ${messageOf(error)}`);
      this.options.onUnreadable();
    }
  }

  private retryLater(reason: string): void {
    this.socket = null;
    if (!navigator.onLine) {
      this.options.onState({ kind: "offline" });
      return;
    }
    if (performance.now() - this.openedAt > GOOD_MS && this.openedAt > 0) this.waitMs = FIRST_WAIT_MS;
    const wait = this.waitMs * (0.75 + 0.5 * Math.random());
    this.waitMs = Math.min(LONGEST_WAIT_MS, 2 * this.waitMs);
    this.openedAt = 0;
    this.options.onState({ kind: "waiting", seconds: Math.ceil(wait / 1000), reason });
    this.timer = setTimeout(() => this.connect(), wait);
  }
}
