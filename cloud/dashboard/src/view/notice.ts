import { button, element } from "./element";

export type NoticeKind = "empty" | "loading" | "error" | "stale";

export interface NoticeAction {
  readonly label: string;
  readonly act: () => void;
}

/** Makes a box with a state and, where there is one, its remedy. */
export function notice(kind: NoticeKind, title: string, detail: string, action?: NoticeAction): HTMLElement {
  const box = element("div", { class: `notice ${kind}`, "data-testid": `notice-${kind}`, role: kind === "error" ? "alert" : null });
  box.append(element("strong", {}, title));
  if (detail) box.append(element("p", {}, detail));
  if (action) box.append(button(action.label, { class: "plain" }, action.act));
  return box;
}

/** Shows one notice at a time; an unchanged notice keeps the focus. */
export class NoticeBoard {
  private shown = "";
  private current: NoticeKind | null = null;

  /** @param root what has nothing else in it while a notice is shown */
  constructor(readonly root: HTMLElement) {}

  /** Of which kind the notice is, if there is one. */
  get kind(): NoticeKind | null {
    return this.current;
  }

  show(kind: NoticeKind, title: string, detail: string, action?: NoticeAction): void {
    const key = `${kind} ${title} ${detail}`;
    if (key === this.shown) return;
    this.shown = key;
    this.current = kind;
    this.root.replaceChildren(notice(kind, title, detail, action));
  }

  clear(): void {
    if (this.shown === "") return;
    this.shown = "";
    this.current = null;
    this.root.replaceChildren();
  }
}
