import type { Problem } from "./contract";

/** A failed request, with a message for the user. */
export class ApiError extends Error {
  /** @param status the HTTP status, or null where the cloud could not be reached */
  constructor(
    message: string,
    readonly status: number | null,
  ) {
    super(message);
    this.name = "ApiError";
  }

  /** Reads RFC 9457 problem details from an answer, or falls back to its status line. */
  static async fromAnswer(answer: Response, path: string): Promise<ApiError> {
    let problem: Problem = {};
    if (answer.headers.get("content-type")?.includes("json")) {
      problem = (await answer.json().catch(() => ({}))) as Problem;
    }
    const text = [problem.title, problem.detail].filter(Boolean).join(": ");
    return new ApiError(text || `${path} answered ${answer.status} ${answer.statusText}`.trim(), answer.status);
  }
}

/** Whether a request was aborted on purpose. */
export function isAbort(error: unknown): boolean {
  return error instanceof DOMException && error.name === "AbortError";
}

/** The message of anything that was thrown. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
