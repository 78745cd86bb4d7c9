import { isAbort, messageOf } from "../api/error";

/** One message of an event stream (WHATWG HTML, section 9.2). */
export interface StreamMessage {
  readonly id: string | null;
  readonly event: string;
  readonly data: string;
}

/** A message longer than this is not one of ours; the connection is then given up. */
const MOST_CHARACTERS = 8_000_000;

/** Cuts the text of an event stream into messages, however the network has split it. */
export class StreamParser {
  private rest = "";
  private id: string | null = null;
  private event = "";
  private data: string[] = [];
  private length = 0;
  /** The id of the last complete event, with or without data: a client resumes after it. */
  lastId: string | null = null;
  /** The reconnection time in ms that the server asked for, if it did. */
  retry: number | null = null;

  /** Takes the next piece of text, and returns the messages that it completes. */
  push(text: string): StreamMessage[] {
    const messages: StreamMessage[] = [];
    const lines = (this.rest + text).split(/\r\n|\n|\r(?!$)/);
    this.rest = lines.pop() ?? "";
    this.length += text.length;
    if (this.length > MOST_CHARACTERS) throw new RangeError("the live stream sent a message that is too long");
    for (const line of lines) {
      if (line === "") this.finish(messages);
      else this.take(line);
    }
    return messages;
  }

  private take(line: string): void {
    const colon = line.indexOf(":");
    if (colon === 0) return;
    const field = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (field === "data") this.data.push(value);
    else if (field === "event") this.event = value;
    else if (field === "id" && !value.includes("\0")) this.id = value;
    else if (field === "retry" && /^\d+$/.test(value)) this.retry = Number(value);
  }

  private finish(messages: StreamMessage[]): void {
    if (this.data.length > 0) {
      messages.push({ id: this.id, event: this.event || "message", data: this.data.join("\n") });
    }
    this.lastId = this.id;
    this.event = "";
    this.data = [];
    this.length = this.rest.length;
  }
}

export type FeedState =
  | { readonly kind: "connecting" }
  | { readonly kind: "open" }
  | { readonly kind: "waiting"; readonly seconds: number; readonly reason: string }
  | { readonly kind: "offline" };

export interface FeedOptions {
  readonly url: string;
  /** The id of the last event of an earlier feed; null to start with new events. */
  readonly after: string | null;
  readonly fetch: typeof fetch;
  readonly random: () => number;
  readonly onMessage: (message: StreamMessage) => void;
  readonly onState: (state: FeedState) => void;
  readonly onUnauthorised: () => void;
}

const FIRST_WAIT_MS = 1_000;
const LONGEST_WAIT_MS = 15_000;
/** The cloud sends a heartbeat every 10 s; three missing ones mean a dead connection. */
const SILENCE_MS = 30_000;

/**
 * A live event stream that resumes where it stopped. EventSource stops at an HTTP error (a
 * restarting cloud, a proxy's 502) and a new one cannot send Last-Event-ID, so the stream is read by fetch.
 */
export class Feed {
  private lastId: string | null;
  private waitMs = FIRST_WAIT_MS;
  private stopped = false;
  private connection: AbortController | null = null;
  private timer: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: FeedOptions) {
    this.lastId = options.after;
  }

  /** The id of the last event received, for another feed to resume after; null before the first. */
  get cursor(): string | null {
    return this.lastId;
  }

  start(): void {
    addEventListener("online", this.onOnline);
    addEventListener("offline", this.onOffline);
    void this.connect();
  }

  stop(): void {
    this.stopped = true;
    removeEventListener("online", this.onOnline);
    removeEventListener("offline", this.onOffline);
    if (this.timer !== null) clearTimeout(this.timer);
    this.connection?.abort();
  }

  private readonly onOnline = (): void => {
    this.waitMs = FIRST_WAIT_MS;
    void this.connect();
  };

  private readonly onOffline = (): void => {
    this.connection?.abort();
    this.options.onState({ kind: "offline" });
  };

  private async connect(): Promise<void> {
    if (this.stopped) return;
    if (this.timer !== null) clearTimeout(this.timer);
    this.connection?.abort();
    const connection = new AbortController();
    this.connection = connection;
    this.options.onState({ kind: "connecting" });
    let reason = "the cloud ended the stream";
    try {
      await this.read(connection);
    } catch (error) {
      reason = isAbort(error) ? "no data for 30 s" : messageOf(error);
    }
    if (!this.stopped && this.connection === connection) this.retryLater(reason);
  }

  private retryLater(reason: string): void {
    if (!navigator.onLine) {
      this.options.onState({ kind: "offline" });
      return;
    }
    const wait = this.waitMs * (0.75 + 0.5 * this.options.random());
    this.waitMs = Math.min(LONGEST_WAIT_MS, 2 * this.waitMs);
    this.options.onState({ kind: "waiting", seconds: Math.ceil(wait / 1000), reason });
    this.timer = setTimeout(() => void this.connect(), wait);
  }

  private async read(connection: AbortController): Promise<void> {
    const headers: Record<string, string> = { Accept: "text/event-stream" };
    if (this.lastId !== null) headers["Last-Event-ID"] = this.lastId;
    let watchdog = setTimeout(() => connection.abort(), SILENCE_MS);
    try {
      const answer = await this.options.fetch(this.options.url, {
        headers,
        credentials: "same-origin",
        cache: "no-store",
        signal: connection.signal,
      });
      if (answer.status === 401) this.options.onUnauthorised();
      if (!answer.ok || answer.body === null) throw new Error(`the live stream answered ${answer.status}`);
      this.options.onState({ kind: "open" });
      const parser = new StreamParser();
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      // Pieces of a stream come one after another.
      // oxlint-disable-next-line no-await-in-loop
      for (let piece = await reader.read(); !piece.done; piece = await reader.read()) {
        clearTimeout(watchdog);
        watchdog = setTimeout(() => connection.abort(), SILENCE_MS);
        for (const message of parser.push(piece.value)) this.deliver(message);
        this.lastId = parser.lastId ?? this.lastId;
        if (parser.retry !== null) this.waitMs = parser.retry;
      }
    } finally {
      clearTimeout(watchdog);
    }
  }

  private deliver(message: StreamMessage): void {
    if (message.id !== null) this.lastId = message.id;
    this.waitMs = FIRST_WAIT_MS;
    this.options.onMessage(message);
  }
}
