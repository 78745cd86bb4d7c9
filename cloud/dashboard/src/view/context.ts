import type { Client } from "../api/client";
import type { Palette } from "../chart/palette";
import type { Route } from "../state/route";
import type { Range } from "../state/window";
import type { Timeline } from "../time/timeline";

/** What every part of the page receives. */
export interface Context {
  readonly client: Client;
  readonly timeline: Timeline;
  readonly palette: Palette;
  readonly route: () => Route;
  /** Navigates; `replace` adds no entry to the browser's history (while zooming and panning). */
  readonly go: (route: Route, how?: "push" | "replace") => void;
  readonly showRange: (range: Range) => void;
  readonly dragPans: () => boolean;
  /** Announces a change to screen readers. */
  readonly announce: (text: string) => void;
  readonly onUnauthorised: () => void;
}
