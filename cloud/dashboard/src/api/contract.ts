import type {
  AlarmDocument, ChannelDocument, CommandDocument, ContactsDocument, CoreDocument, EnergyDocument, EventDocument, FaultDocument, FormulaTotalsDocument, GatewayDocument, GestureDocument,
  LagDocument, LayoutDocument, ModelDocument, MonitorDocument, NodeDocument, NodeMonitorDocument, ParameterDocument, PredictionDocument, SeriesDocument, StateDocument, StorageDocument,
  TotalsDocument, VerdictDocument,
} from "./schema";

/** The answers of the REST API under /api/v1; docs/rest.md explains their fields. */

export type Health = NodeDocument["health"];
export type Verdict = EnergyDocument["self_sustaining"];

export type NodeItem = NodeDocument;
export type EnergyJson = EnergyDocument;
export type FaultJson = FaultDocument;
export type LagJson = LagDocument;
export type GatewayItem = GatewayDocument;
export type StorageAnswer = StorageDocument;
/** A channel, as far as the dashboard reads it. */
export type ChannelItem = Pick<ChannelDocument, "id" | "taxel" | "quantity" | "unit" | "coverage" | "dt" | "first" | "last" | "biometric">;
export type EventItem = EventDocument;
export type ModelItem = ModelDocument;
export type ModelParameter = ParameterDocument;
export type CommandItem = CommandDocument;
export type NodeState = StateDocument;
export type PredictionAnswer = PredictionDocument;
/** A series; the dashboard does not read its means. */
export type SeriesAnswer = Omit<SeriesDocument, "mean">;
export type LayoutItem = LayoutDocument;
export type ContactsItem = ContactsDocument;
export type CoreItem = CoreDocument;
export type GestureItem = GestureDocument;
export type VerdictItem = VerdictDocument;
export type TotalsAnswer = TotalsDocument;
export type FormulaTotalsAnswer = FormulaTotalsDocument;
export type AlarmItem = AlarmDocument;
export type MonitorItem = MonitorDocument;
export type NodeMonitorItem = NodeMonitorDocument;

/** The settings of each target: a channel, a taxel, or "*" for the whole node. */
export type Settings = StateDocument["desired"];
export type Setting = Settings[string][string];

export interface Page<Item> {
  readonly items: readonly Item[];
  readonly next: string | null;
}

/** RFC 9457 problem details. */
export interface Problem {
  readonly type?: string;
  readonly title?: string;
  readonly status?: number;
  readonly detail?: string;
  readonly instance?: string;
}
