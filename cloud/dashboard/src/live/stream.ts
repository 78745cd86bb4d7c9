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
  /** Where whoever breaks off now goes on: what was last complete has this id, also where it held no message. */
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
