import type { Client } from "../api/client";
import type { GatewayItem, StorageAnswer } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { formatDuration, formatLag } from "../time/duration";
import { element } from "./element";
import { fact, fillMeter, formatBytes, hasRoom, seenAgo } from "./fact";
import { notice } from "./notice";
import { healthSymbol } from "./symbol";

function spoolFacts({ spool, nodes }: GatewayItem): HTMLElement[] {
  if (spool === null) return fact("spool", "unknown");
  const oldest = spool.oldest_ns === null ? "–" : formatDuration(spool.oldest_ns, "up");
  return [
    ...fact("spool", fillMeter("spool fill", spool), hasRoom(spool)),
    ...fact("oldest", oldest, true),
    ...fact("nodes", String(nodes ?? "–"), true),
    ...(spool.dead_letters > 0 ? fact("dead letters", element("span", { class: "warn" }, String(spool.dead_letters))) : []),
  ];
}

/** A gateway's card: health, lag, spool and counts. */
export function gatewayCard(gateway: GatewayItem, now: bigint, reachable: boolean): HTMLElement {
  const health = reachable ? gateway.health : "unknown";
  const { stored, duplicate, rejected, spool } = gateway;
  const head = element("div", { class: "card-head" }, healthSymbol(health), element("strong", {}, gateway.id.replace(".", " ")), element("span", { class: `badge ${health}` }, health));
  const refused = rejected === null ? "–" : rejected > 0 ? element("span", { class: "warn" }, rejected.toLocaleString("en")) : "0";
  const facts = element(
    "dl",
    { class: "facts" },
    ...fact("seen", seenAgo(gateway.last_heard, now), true),
    ...fact("lag", element("span", { "data-testid": "gateway-lag" }, formatLag(gateway.lag))),
    ...spoolFacts(gateway),
    ...fact("stored", element("span", { title: duplicate === null ? "" : `${duplicate} duplicates` }, stored?.toLocaleString("en") ?? "–"), true),
    ...fact("rejected", refused, rejected === 0),
  );
  const fill = spool && `spool ${formatBytes(spool.bytes)} of ${formatBytes(spool.capacity_bytes)}, reported ${spool.reported}`;
  const counts = `stored ${stored ?? "unknown"}, duplicate ${duplicate ?? "unknown"}, rejected ${rejected ?? "unknown"}`;
  const title = [gateway.id, `first seen ${gateway.first_heard}`, counts, fill].filter(Boolean).join("\n");
  return element("section", { class: "card", "data-testid": "gateway", "data-gateway": gateway.id, "data-health": health, "aria-label": `gateway ${gateway.id}`, title }, head, facts);
}

/** The store's size, whole and per sample. */
export function storageCard({ bytes, free_bytes, samples, bytes_per_sample }: StorageAnswer): HTMLElement {
  const each = bytes_per_sample === null ? "–" : `${(Math.ceil(bytes_per_sample * 100) / 100).toFixed(2)} B`;
  const facts = element(
    "dl",
    { class: "facts" },
    ...fact("per sample", element("span", { "data-testid": "bytes-per-sample" }, each)),
    ...fact("samples", samples.toLocaleString("en"), true),
    ...fact("size", formatBytes(bytes)),
    ...fact("reusable", formatBytes(free_bytes), true),
  );
  const title = `${samples} samples, ${formatBytes(free_bytes)} reusable\nPer sample: the size of the store with all indices, without its free space`;
  return element("section", { class: "card", "data-testid": "storage", "aria-label": "store", title }, element("div", { class: "card-head" }, element("strong", {}, "Store")), facts);
}

/** The gateways and the store, shown beside all nodes. */
export class StackStrip {
  readonly root = element("section", { class: "nodes stack", "aria-label": "gateways and store", "data-testid": "stack" });
  private gateways: readonly GatewayItem[] | null = null;
  private storage: StorageAnswer | null = null;
  private failure = "";
  private drawn = "";

  /** Loads both; a failure is shown while there are no cards. */
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
    const none = gateways.length === 0 ? [notice("empty", "No gateway has connected yet", "")] : [];
    return [...none, ...gateways.map((gateway) => gatewayCard(gateway, now, reachable)), storageCard(storage)];
  }
}
