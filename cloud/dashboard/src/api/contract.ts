import type { IntervalJson } from "../interval/interval";

/** The shapes that the cloud answers with, under /api/v1. */

export type Health = "online" | "late" | "offline";
export type Verdict = "certain" | "possible";
export type EventKind = "peak" | "gap" | "status" | "command" | "conflict";

export interface Page<Item> {
  readonly items: readonly Item[];
  readonly next: string | null;
}

export interface EnergyJson {
  /** In J. */
  readonly stored: IntervalJson;
  /** From 0 at brown-out to 1 when full. */
  readonly charge: IntervalJson;
  readonly self_sustaining: "certain" | "possible" | "impossible";
  readonly shedding: "none" | "adaptive" | "peaks" | "sleep";
}

export interface FaultJson {
  readonly taxel: string;
  readonly dead: "certain" | "possible" | "impossible";
  readonly stuck: "certain" | "possible" | "impossible";
}

/** How long after its last sample the latest block was stored: an enclosure. */
export interface LagJson {
  readonly lo_ns: number;
  readonly hi_ns: number;
}

export interface GatewayItem {
  readonly id: string;
  readonly health: Health;
  readonly first_heard: string;
  readonly last_heard: string;
  readonly nodes: number | null;
  readonly spool: {
    readonly told: string;
    readonly messages: number;
    readonly bytes: number;
    readonly capacity_bytes: number;
    readonly oldest_ns: number | null;
    readonly dead_letters: number;
  } | null;
  /** Null, as are spool and lag, where they would count what is sealed, and the reader lacks the scope. */
  readonly stored: number | null;
  readonly duplicate: number | null;
  readonly rejected: number | null;
  readonly lag: LagJson | null;
}

/** What the store takes of the disk. */
export interface StorageAnswer {
  readonly bytes: number;
  readonly free_bytes: number;
  readonly samples: number;
  readonly bytes_per_sample: number | null;
}

export interface NodeItem {
  readonly id: string;
  readonly health: Health;
  readonly last_seen: string;
  readonly boot: number;
  /** Null where it would count what is sealed, and the reader lacks the scope. */
  readonly sequence: number | null;
  readonly profile: string | null;
  readonly description: string | null;
  readonly uptime_ns: number | null;
  readonly outbox: { readonly messages: number; readonly bytes: number; readonly capacity_bytes: number } | null;
  readonly gaps: number;
  readonly energy: EnergyJson | null;
  /** Taxels that may be broken; none known before the node's first self-test. */
  readonly faults: readonly FaultJson[] | null;
  readonly channels: number;
  readonly lag: LagJson | null;
  /** Whether the node's clock holds its bound, by its latest status. */
  readonly clock: {
    readonly verdict: "certain" | "possible" | "impossible";
    readonly offset: { readonly lo_ns: number | null; readonly hi_ns: number | null };
    readonly references_agree: boolean;
  } | null;
  /** Messages that it made and that are stored nowhere, though no gap names them. */
  readonly missing: { readonly messages: number; readonly since: string } | null;
}

/** A taxel that sits somewhere: x and y of its centre in m, on a flat map of the skin. */
export interface TaxelItem {
  readonly id: string;
  readonly position_m: readonly [number, number];
}

export interface ChannelItem {
  readonly id: string;
  readonly taxel: string;
  readonly quantity: string;
  readonly unit: string;
  readonly coverage: number;
  readonly dt: number;
  readonly blocks: number | null;
  readonly samples: number | null;
  /** What its blocks take in the store, without indices and hulls; null for a sealed channel. */
  readonly bytes: number | null;
  readonly first: string | null;
  readonly last: string | null;
  readonly bounds: IntervalJson | null;
}

export interface SeriesAnswer {
  readonly node: string;
  readonly channel: string;
  readonly unit: string;
  readonly coverage: number;
  readonly resolution: "sample" | "hull";
  readonly t0: string;
  readonly t: readonly number[];
  readonly lo: readonly (number | null)[];
  readonly hi: readonly (number | null)[];
  readonly dt: number;
  readonly time_error: number;
}

/** A live block: a series, and when the cloud stored it by its own clock. */
export interface LiveBlock extends SeriesAnswer {
  readonly stored: string;
}

/** A parameter of a model; its unit is null where it is the channel's own. */
export interface ModelParameter {
  readonly name: string;
  readonly unit: string | null;
  readonly required: boolean;
  /** Bounds to begin with. */
  readonly usual: IntervalJson | null;
}

/** A quantity of a model; its unit is null where it fits every channel. */
export interface ModelItem {
  readonly id: string;
  readonly unit: string | null;
  readonly description: string;
  readonly parameters: readonly ModelParameter[];
}

/** A predicted tube: an enclosure of all that is predicted in each [t, t + dt]. */
export interface PredictionAnswer {
  readonly t0: string;
  readonly t: readonly number[];
  readonly lo: readonly (number | null)[];
  readonly hi: readonly (number | null)[];
  readonly dt: number;
}

/** For how long and how often a channel was in a state; for `unknown_s` nothing is known. */
export interface OccupancyAnswer {
  readonly time_s: { readonly lo: number; readonly hi: number };
  readonly unknown_s: number;
  readonly samples: { readonly lo: number; readonly hi: number };
  readonly entries: { readonly lo: number; readonly hi: number };
  readonly coverage: number;
  readonly time_error: number;
}

export interface SegmentItem {
  readonly id: string;
  readonly start: string;
  readonly end: string;
  readonly verdict: Verdict;
  readonly time_error: number;
}

export interface EventItem {
  readonly id: string;
  readonly node: string;
  readonly channel: string | null;
  readonly kind: EventKind;
  readonly verdict: Verdict | null;
  readonly time: { readonly lo: string; readonly hi: string };
  readonly height: IntervalJson | null;
  readonly prominence: IntervalJson | null;
  readonly count: IntervalJson | null;
  readonly unit: string | null;
  readonly coverage: number | null;
  readonly boot: number;
  readonly detail: string | null;
}

export type Setting = number | string;
/** Settings of each place: a channel, a taxel, or "*" for the whole node. */
export type Settings = Readonly<Record<string, Readonly<Record<string, Setting>>>>;

export interface NodeState {
  readonly node: string;
  readonly desired: Settings;
  readonly desired_at: string | null;
  readonly desired_by: number | null;
  readonly reported: Settings | null;
  readonly reported_at: { readonly lo: string; readonly hi: string } | null;
  readonly reported_by: number | null;
  readonly settled: boolean;
}

/** RFC 9457 problem details. */
export interface Problem {
  readonly type?: string;
  readonly title?: string;
  readonly status?: number;
  readonly detail?: string;
  readonly instance?: string;
}
