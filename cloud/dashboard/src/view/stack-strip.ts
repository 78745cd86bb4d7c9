import type { Client } from "../api/client";
import type { GatewayItem, StorageAnswer } from "../api/contract";
import { isAbort, messageOf } from "../api/failure";
import { element } from "./element";
import { gatewayCard, storageCard } from "./gateway-card";
import { notice } from "./notice";

/** What stands behind the nodes: gateways and the store; shown beside all nodes. */
export class StackStrip {
  readonly root = element("section", { class: "nodes stack", "aria-label": "gateways and store", "data-testid": "stack" });
  private gateways: readonly GatewayItem[] | null = null;
  private storage: StorageAnswer | null = null;
  private failure = "";
  private drawn = "";

  /** Asks the cloud; what cannot be had is said in place of the cards, as long as there are none. */
  async load(client: Client, signal: AbortSignal): Promise<void> {
    try {
      [this.gateways, this.storage] = await Promise.all([client.gateways(signal), client.storage(signal)]);
      this.failure = "";
    } catch (error) {
      if (!isAbort(error)) this.failure = messageOf(error);
    }
  }

  show(now: bigint, reachable: boolean): void {
    const state = JSON.stringify([this.gateways, this.storage, this.failure, reachable, this.gateways && Number(now / 1_000_000_000n)]);
    if (state === this.drawn) return;
    this.drawn = state;
    this.root.replaceChildren(...this.cards(now, reachable));
  }

  private cards(now: bigint, reachable: boolean): readonly HTMLElement[] {
    const { gateways, storage, failure } = this;
    if (gateways === null || storage === null) {
      return failure === "" ? [] : [notice("error", "Gateways and store could not be loaded", failure)];
    }
    const none = gateways.length === 0 ? [notice("empty", "No gateway was heard yet", "")] : [];
    return [...none, ...gateways.map((gateway) => gatewayCard(gateway, now, reachable)), storageCard(storage)];
  }
}
