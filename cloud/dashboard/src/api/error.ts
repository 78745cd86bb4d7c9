import type { Problem } from "./contract";

/** A request that did not bring what was asked for, with what a person needs to know about it. */
export class ApiError extends Error {
  /** @param status the HTTP status, or null when the cloud could not be reached at all */
  constructor(
    message: string,
    readonly status: number | null,
  ) {
    super(message);
    this.name = "ApiError";
  }

  /** Reads RFC 9457 problem details from an answer, or makes do with its status line. */
  static async fromAnswer(answer: Response, path: string): Promise<ApiError> {
    let problem: Problem = {};
    if (answer.headers.get("content-type")?.includes("json")) {
      problem = (await answer.json().catch(() => ({}))) as Problem;
    }
    const said = [problem.title, problem.detail].filter(Boolean).join(": ");
    return new ApiError(said || `${path} answered ${answer.status} ${answer.statusText}`.trim(), answer.status);
  }
}

/** Tells a request that was given up on purpose from one that failed. */
export function isAbort(error: unknown): boolean {
  return error instanceof DOMException && error.name === "AbortError";
}

/** The message of anything that was thrown. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
