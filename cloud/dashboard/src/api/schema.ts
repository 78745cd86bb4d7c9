/* Written by `python -m docs.tools.openapi --typescript`: do not edit. */

export interface AlarmDocument {
  readonly id: number;
  readonly monitor: string;
  readonly revision: number;
  readonly formula: string;
  readonly severity: string;
  readonly verdict: "possible" | "certain";
  readonly state: "raised" | "cleared";
  readonly began: string;
  readonly ended: string | null;
  readonly raised: string;
  readonly acknowledged: string | null;
  readonly acknowledged_by: string | null;
  readonly escalated: string | null;
  readonly cleared: string | null;
}

export interface AlarmHistoryDocument {
  readonly id: number;
  readonly monitor: string;
  readonly revision: number;
  readonly formula: string;
  readonly severity: string;
  readonly verdict: "possible" | "certain";
  readonly state: "raised" | "cleared";
  readonly began: string;
  readonly ended: string | null;
  readonly raised: string;
  readonly acknowledged: string | null;
  readonly acknowledged_by: string | null;
  readonly escalated: string | null;
  readonly cleared: string | null;
  readonly transitions: readonly TransitionDocument[];
}

export interface AuditEntryDocument {
  readonly id: number;
  readonly time: string;
  readonly actor: string;
  readonly address: string;
  readonly action: string;
  readonly target: string;
  readonly detail: string;
  readonly digest: string;
}

export interface BoundsDocument {
  readonly lo: readonly (number | null)[];
  readonly hi: readonly (number | null)[];
}

export interface ChannelDocument {
  readonly id: string;
  readonly taxel: string;
  readonly quantity: string;
  readonly unit: string;
  readonly coverage: number;
  readonly dt: number | null;
  readonly first: string | null;
  readonly last: string | null;
  readonly biometric: boolean;
  readonly patch: string;
  readonly removed: RemovedDocument | null;
}

export interface ClockDocument {
  readonly verdict: "certain" | "possible" | "impossible";
  readonly offset: OffsetDocument;
  readonly references_agree: boolean;
}

export interface CommandDocument {
  readonly id: number;
  readonly node: string;
  readonly name: "calibrate" | "set" | "reset" | "monitor" | "challenge";
  readonly arguments: Readonly<Record<string, number | string>>;
  readonly state: "pending" | "delivered" | "done" | "refused" | "expired";
  readonly reason: string | null;
  readonly issued: string;
  readonly expires: string;
  readonly delivered: string | null;
  readonly answered: TimeDocument | null;
}

export interface ContactsDocument {
  readonly node: string;
  readonly nodes: readonly string[];
  readonly t: string;
  readonly time_error: number;
  readonly threshold: number;
  readonly unit: string;
  readonly cores: readonly CoreDocument[];
  readonly regions: readonly RegionDocument[];
}

export interface ControllerDocument {
  readonly node: string;
  readonly pages: number;
}

export interface CoreDocument {
  readonly cells: readonly [number, number];
  readonly area: readonly [number | null, number | null];
  readonly force: readonly [number | null, number | null];
  readonly centroid: readonly (readonly [number | null, number | null])[];
  readonly taxels: readonly string[];
}

export interface CountDocument {
  readonly lo: number;
  readonly hi: number;
}

export interface EnergyDocument {
  readonly stored: IntervalDocument;
  readonly charge: IntervalDocument;
  readonly self_sustaining: "certain" | "possible" | "impossible";
  readonly shedding: "none" | "adaptive" | "peaks" | "sleep";
}

export interface EventDocument {
  readonly id: string;
  readonly node: string;
  readonly channel: string | null;
  readonly kind: "peak" | "gap" | "contact" | "verdict" | "status" | "command" | "conflict";
  readonly verdict: "certain" | "possible" | "impossible" | null;
  readonly time: TimeDocument;
  readonly height: IntervalDocument | null;
  readonly prominence: IntervalDocument | null;
  readonly count: IntervalDocument | null;
  readonly unit: string | null;
  readonly coverage: number | null;
  readonly boot: number;
  readonly detail: string | null;
}

export interface FaultDocument {
  readonly taxel: string;
  readonly dead: "certain" | "possible" | "impossible";
  readonly stuck: "certain" | "possible" | "impossible";
}

export interface FormulaTotalsDocument {
  readonly start: string;
  readonly end: string;
  readonly time_s: IntervalDocument;
  readonly unknown_s: number;
  readonly entries: CountDocument;
  readonly coverage: number;
  readonly false_a_year: number;
}

export interface GatewayDocument {
  readonly id: string;
  readonly site: string;
  readonly health: "online" | "late" | "offline";
  readonly first_heard: string;
  readonly last_heard: string;
  readonly nodes: number | null;
  readonly spool: SpoolDocument | null;
  readonly stored: number | null;
  readonly duplicate: number | null;
  readonly rejected: number | null;
  readonly latest: string | null;
  readonly lag: LagDocument | null;
}

export interface GestureDocument {
  readonly kind: "tap" | "press" | "hold" | "slide" | "swipe" | "double tap" | "pinch" | "spread" | "rotation";
  readonly verdict: "possible" | "certain";
  readonly contacts: readonly number[];
  readonly begin: SampledInstantDocument;
  readonly end: SampledInstantDocument;
  readonly direction: IntervalDocument | null;
  readonly angle: IntervalDocument | null;
  readonly scale: IntervalDocument | null;
  readonly places: readonly TouchPlacesDocument[];
}

export interface HealthDocument {
  readonly status?: "ok";
}

export interface IntervalDocument {
  readonly lo: number | null;
  readonly hi: number | null;
}

export interface LagDocument {
  readonly lo_ns: number;
  readonly hi_ns: number;
}

export interface LayoutDocument {
  readonly layout: string;
  readonly patches: readonly PatchDocument[];
  readonly seams: readonly SeamDocument[];
  readonly controllers: readonly ControllerDocument[];
  readonly outline: readonly (readonly [readonly number[], readonly number[]])[];
}

export interface LiveVerdictDocument {
  readonly verdict: "certain" | "possible" | "impossible";
  readonly missing: boolean;
  readonly until: string;
}

export interface MissingDocument {
  readonly messages: number;
  readonly since: string;
  readonly ranges: readonly MissingRangeDocument[];
}

export interface MissingRangeDocument {
  readonly boot: number;
  readonly first: number;
  readonly last: number;
}

export interface ModelDocument {
  readonly id: string;
  readonly unit: string | null;
  readonly description: string;
  readonly parameters: readonly ParameterDocument[];
}

export interface MonitorDocument {
  readonly name: string;
  readonly formula: string;
  readonly node: string | null;
  readonly raise_on: "never" | "possible" | "certain";
  readonly missing: boolean;
  readonly severity: string;
  readonly clear_after_s: number;
  readonly escalate_after_s: number | null;
  readonly silenced_until: string | null;
  readonly created: string;
  readonly changed: string;
  readonly revision: number;
  readonly latest: LiveVerdictDocument | null;
  readonly problem: string | null;
  readonly alarm: number | null;
}

export interface NewTokenDocument {
  readonly id: string;
  readonly token: string;
}

export interface NodeDocument {
  readonly id: string;
  readonly health: "online" | "late" | "offline";
  readonly last_seen: string;
  readonly boot: number;
  readonly sequence: number | null;
  readonly profile: string | null;
  readonly description: string | null;
  readonly uptime_ns: number | null;
  readonly outbox: OutboxDocument | null;
  readonly gaps: number;
  readonly energy: EnergyDocument | null;
  readonly faults: readonly FaultDocument[] | null;
  readonly channels: number | null;
  readonly layout: string | null;
  readonly lag: LagDocument | null;
  readonly clock: ClockDocument | null;
  readonly missing: MissingDocument | null;
}

export interface NodeMonitorDocument {
  readonly name: string;
  readonly formula: string;
  readonly on: "possible" | "certain";
  readonly output: "none" | "stop" | "out1" | "out2" | "out3";
  readonly desired: Readonly<Record<string, number | string>> | null;
  readonly reported: Readonly<Record<string, number | string>> | null;
  readonly latest: StatedVerdictDocument | null;
  readonly level: "on" | "off" | null;
}

export interface OffsetDocument {
  readonly lo_ns: number | null;
  readonly hi_ns: number | null;
}

export interface OutboxDocument {
  readonly messages: number;
  readonly bytes: number;
  readonly capacity_bytes: number;
}

export interface ParameterDocument {
  readonly name: string;
  readonly unit: string | null;
  readonly required: boolean;
  readonly usual: IntervalDocument | null;
}

export interface PatchDocument {
  readonly patch: string;
  readonly hash: string;
  readonly quantity: string;
  readonly unit: string;
  readonly taxels: readonly string[];
  readonly positions: readonly (readonly number[])[];
  readonly neighbours: readonly (readonly [number, number])[];
  readonly least_width: number;
  readonly threshold: number | null;
  readonly cell_area: number | null;
  readonly page: number;
  readonly node: string;
}

export interface PicturesDocument {
  readonly node: string;
  readonly layout: string;
  readonly quantity: string;
  readonly unit: string;
  readonly coverage: number;
  readonly t0: string;
  readonly dt: number;
  readonly time_error: number;
  readonly taxels: readonly string[];
  readonly t: readonly number[];
  readonly lo: readonly (readonly (number | null)[])[];
  readonly hi: readonly (readonly (number | null)[])[];
  readonly contact: readonly (readonly number[])[] | null;
}

export interface PredictionDocument {
  readonly node: string;
  readonly channel: string;
  readonly model: string;
  readonly unit: string;
  readonly origin: string;
  readonly t0: string;
  readonly t: readonly number[];
  readonly lo: readonly (number | null)[];
  readonly hi: readonly (number | null)[];
  readonly dt: number;
}

export interface ReceiverDocument {
  readonly name: string;
  readonly delivered: number;
  readonly waiting: number;
  readonly attempts: number;
  readonly failing_since: string | null;
  readonly next_attempt: string | null;
  readonly error: string | null;
  readonly given_up: number;
}

export interface RegionDocument {
  readonly contacts: readonly [number, number];
  readonly taxels: readonly string[];
}

export interface RemovedDocument {
  readonly messages: number;
  readonly before: string;
}

export interface SampledInstantDocument {
  readonly lo: string | null;
  readonly hi: string | null;
}

export interface SeamDocument {
  readonly first: number;
  readonly second: number;
  readonly pairs: readonly (readonly [number, number])[];
}

export interface SeriesDocument {
  readonly node: string;
  readonly channel: string;
  readonly unit: string;
  readonly coverage: number;
  readonly resolution: "sample" | "hull";
  readonly t0: string;
  readonly t: readonly number[];
  readonly lo: readonly (number | null)[];
  readonly hi: readonly (number | null)[];
  readonly mean: BoundsDocument | null;
  readonly dt: number;
  readonly time_error: number;
}

export interface SessionDocument {
  readonly id: string;
  readonly name: string;
  readonly scopes: readonly ("read" | "operate" | "admin" | "biometric")[];
  readonly expires: string;
}

export interface SpoolDocument {
  readonly reported: string;
  readonly messages: number;
  readonly bytes: number;
  readonly capacity_bytes: number;
  readonly oldest_ns: number | null;
  readonly dead_letters: number;
}

export interface StateDocument {
  readonly node: string;
  readonly desired: Readonly<Record<string, Readonly<Record<string, number | string>>>>;
  readonly desired_at: string | null;
  readonly desired_by: number | null;
  readonly reported: Readonly<Record<string, Readonly<Record<string, number | string>>>> | null;
  readonly reported_at: TimeDocument | null;
  readonly reported_by: number | null;
  readonly settled: boolean;
}

export interface StatedVerdictDocument {
  readonly verdict: "certain" | "possible" | "impossible";
  readonly time: TimeDocument;
  readonly final: boolean;
  readonly because: readonly ("width" | "instant" | "gap" | "pending")[];
  readonly coverage: number;
  readonly current: boolean;
}

export interface StorageDocument {
  readonly bytes: number;
  readonly free_bytes: number;
  readonly samples: number;
  readonly bytes_per_sample: number | null;
}

export interface SubjectDocument {
  readonly id: string;
  readonly site: string;
  readonly nodes: readonly string[];
  readonly messages: number | null;
  readonly erased: string | null;
}

export interface TimeDocument {
  readonly lo: string;
  readonly hi: string;
}

export interface TokenDocument {
  readonly id: string;
  readonly name: string;
  readonly scopes: readonly ("read" | "operate" | "admin" | "biometric")[];
  readonly state: "good" | "expired" | "revoked";
  readonly created: string;
  readonly expires: string | null;
  readonly revoked: string | null;
}

export interface TotalsDocument {
  readonly start: string;
  readonly end: string;
  readonly time_s: IntervalDocument;
  readonly unknown_s: number;
  readonly entries: CountDocument;
  readonly coverage: number;
}

export interface TouchPlacesDocument {
  readonly begin: readonly (readonly [number | null, number | null])[];
  readonly end: readonly (readonly [number | null, number | null])[];
}

export interface TransitionDocument {
  readonly number: number;
  readonly transition: "raised" | "acknowledged" | "escalated" | "unsilenced" | "cleared";
  readonly time: string;
  readonly silenced: boolean;
}

export interface VerdictDocument {
  readonly start: string;
  readonly includes_start: boolean;
  readonly end: string;
  readonly includes_end: boolean;
  readonly verdict: "certain" | "possible" | "impossible";
  readonly because: readonly ("width" | "instant" | "gap" | "pending")[];
  readonly missing: boolean;
  readonly coverage: number;
}
