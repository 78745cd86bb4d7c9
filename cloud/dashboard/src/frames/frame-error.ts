/** Bytes that are no frame as docs/messages.md describes it. */
export class FrameError extends Error {
  constructor(message: string) {
    super(message);
    this.name = "FrameError";
  }
}
