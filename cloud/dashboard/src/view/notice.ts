import { button, element } from "./element";

export type NoticeKind = "empty" | "loading" | "error" | "stale";

export interface NoticeAction {
  readonly label: string;
  readonly act: () => void;
}

/** Makes a box that says what is going on, and what to do about it. */
export function notice(kind: NoticeKind, title: string, detail: string, action?: NoticeAction): HTMLElement {
  const box = element("div", { class: `notice ${kind}`, "data-testid": `notice-${kind}`, role: kind === "error" ? "alert" : null });
  box.append(element("strong", {}, title));
  if (detail) box.append(element("p", {}, detail));
  if (action) box.append(button(action.label, { class: "plain" }, action.act));
  return box;
}

/** A place where one notice at a time is shown; one that stands there already is left in peace, with its focus. */
export class NoticeBoard {
  private shown = "";
  private said: NoticeKind | null = null;

  /** @param root what has nothing else in it while a notice is shown */
  constructor(readonly root: HTMLElement) {}

  /** Of which kind the notice is, if there is one. */
  get kind(): NoticeKind | null {
    return this.said;
  }

  say(kind: NoticeKind, title: string, detail: string, action?: NoticeAction): void {
    const key = `${kind} ${title} ${detail}`;
    if (key === this.shown) return;
    this.shown = key;
    this.said = kind;
    this.root.replaceChildren(notice(kind, title, detail, action));
  }

  clear(): void {
    if (this.shown === "") return;
    this.shown = "";
    this.said = null;
    this.root.replaceChildren();
  }
}
