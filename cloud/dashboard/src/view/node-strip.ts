import type { NodeItem } from "../api/contract";
import { printPlace } from "../state/place";
import type { Context } from "./context";
import { element } from "./element";
import { nodeCard } from "./node-card";

/** The overview of all nodes, above every view. */
export class NodeStrip {
  readonly root = element("nav", { class: "nodes", "aria-label": "nodes", "data-testid": "nodes" });
  private drawn = "";
  private linked = "";

  constructor(private readonly context: Context) {}

  /**
   * Draws the cards anew when anything has changed; the focus stays on its card. Where only the window has, as with
   * every step of a gesture, it is enough that they lead to it.
   *
   * @param reachable whether the cloud answers: if not, nobody knows how the nodes are
   */
  show(nodes: readonly NodeItem[], now: bigint, reachable: boolean): void {
    const place = this.context.place();
    const state = JSON.stringify([nodes, reachable, place.node, Number(now / 1_000_000_000n)]);
    const links = printPlace({ ...place, node: null });
    const same = state === this.drawn;
    if (same && links === this.linked) return;
    [this.drawn, this.linked] = [state, links];
    if (same) {
      for (const [index, node] of nodes.entries()) this.root.children[index]?.setAttribute("href", this.href(node.id));
      return;
    }
    const cards = nodes.map((node) => nodeCard(node, { href: this.href(node.id), current: place.node === node.id, now, reachable }));
    const held = new Map([...this.root.children].map((card) => [card.getAttribute("data-node"), card]));
    for (const [index, card] of cards.entries()) {
      const shown = this.adopt(held.get(card.getAttribute("data-node")) ?? null, card);
      if (this.root.children[index] !== shown) this.root.insertBefore(shown, this.root.children[index] ?? null);
    }
    while (this.root.children.length > cards.length) this.root.lastElementChild?.remove();
  }

  /** Where a card leads: to its node, and from that back to all of them. */
  private href(node: string): string {
    const place = this.context.place();
    const back = place.node === node && place.channel === null;
    return printPlace({ ...place, node: back ? null : node, channel: null, question: null });
  }

  /** Fills a card that is on the page already, so that a click or the focus on it is not lost. */
  private adopt(held: Element | null, card: Element): Element {
    if (held === null) return card;
    for (const name of held.getAttributeNames()) if (!card.hasAttribute(name)) held.removeAttribute(name);
    for (const { name, value } of card.attributes) held.setAttribute(name, value);
    held.replaceChildren(...card.childNodes);
    return held;
  }
}
