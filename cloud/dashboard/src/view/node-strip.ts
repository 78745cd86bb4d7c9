import type { NodeItem } from "../api/contract";
import { printPlace } from "../state/place";
import type { Context } from "./context";
import { element } from "./element";
import { nodeCard } from "./node-card";

/** The overview of all nodes, above every view. */
export class NodeStrip {
  readonly root = element("nav", { class: "nodes", "aria-label": "nodes", "data-testid": "nodes" });
  private drawn = "";

  constructor(private readonly context: Context) {}

  /**
   * Draws the cards anew when anything has changed; the focus stays on its card.
   *
   * @param reachable whether the cloud answers: if not, nobody knows how the nodes are
   */
  show(nodes: readonly NodeItem[], now: bigint, reachable: boolean): void {
    const place = this.context.place();
    const state = JSON.stringify([nodes, reachable, place.node, printPlace({ ...place, node: null }), Number(now / 1_000_000_000n)]);
    if (state === this.drawn) return;
    this.drawn = state;
    const cards = nodes.map((node) => {
      const current = place.node === node.id;
      const back = current && place.channel === null;
      const target = { ...place, node: back ? null : node.id, channel: null, question: null };
      return nodeCard(node, { href: printPlace(target), current, now, reachable });
    });
    const held = new Map([...this.root.children].map((card) => [card.getAttribute("data-node"), card]));
    for (const [index, card] of cards.entries()) {
      const shown = this.adopt(held.get(card.getAttribute("data-node")) ?? null, card);
      if (this.root.children[index] !== shown) this.root.insertBefore(shown, this.root.children[index] ?? null);
    }
    while (this.root.children.length > cards.length) this.root.lastElementChild?.remove();
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
