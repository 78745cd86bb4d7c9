import type { Instant } from "../time/instant";
import type {
  AlarmItem, ChannelItem, CommandItem, ContactsItem, EventItem, FormulaTotalsAnswer, GatewayItem, GestureItem, LayoutItem, ModelItem, MonitorItem, NodeItem, NodeMonitorItem,
  NodeState, Page, PredictionAnswer, SeriesAnswer, StorageAnswer, TotalsAnswer, VerdictItem,
} from "./contract";
import { ApiError, isAbort } from "./error";

export type Query = Readonly<Record<string, string | number | bigint | readonly string[] | null | undefined>>;

/** A channel of a node. */
export interface ChannelRef {
  readonly node: string;
  readonly channel: string;
}

export interface EventQuery {
  readonly node?: string | undefined;
  readonly channel?: string | undefined;
  readonly kind?: string | undefined;
  readonly verdict?: string | undefined;
  readonly start?: Instant | undefined;
  readonly end?: Instant | undefined;
  readonly limit?: number | undefined;
  readonly cursor?: string | undefined;
}

/** Pictures of a window of the past. */
export interface FilmQuery {
  readonly start: Instant;
  readonly end: Instant;
  readonly points: number;
  readonly quantity: string;
}

/** What a model predicts: which, from when on, and with which parameters (NAME:LO:HI). */
export interface PredictionQuery {
  readonly model: string;
  readonly origin: Instant;
  readonly parameter: readonly string[];
  readonly start: Instant;
  readonly end: Instant;
}

/** Which values are asked for, above or below a level, and when. */
export interface ThresholdQuery {
  readonly above?: number;
  readonly below?: number;
  readonly start: Instant;
  readonly end: Instant;
}

/** A formula over channels of a node, and when. */
export interface WindowedFormula {
  readonly formula: string;
  readonly node: string;
  readonly start: Instant;
  readonly end: Instant;
}

/** What a monitor is that the cloud evaluates live. */
export interface MonitorDefinition {
  readonly formula: string;
  readonly node: string;
  readonly raise_on: string;
}

export interface ClientOptions {
  readonly fetch: typeof fetch;
  /** Called when the session is over; the page then goes to the login. */
  readonly onUnauthorised: () => void;
}

const ROOT = "/api/v1";
/** A list is followed over at most so many pages, so that no question runs away. */
const MOST_PAGES = 20;
const EVENTS_AT_ONCE = 500;
const CHANGE_MS = 30_000;

/** Writes a path with its query; empty and absent values are left out, lists are repeated. */
export function address(path: string, query: Query = {}): string {
  const pairs = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) {
    if (value === undefined || value === null || value === "") continue;
    for (const one of Array.isArray(value) ? value : [value]) pairs.append(name, String(one));
  }
  const text = pairs.toString();
  return `${ROOT}${path}${text ? `?${text}` : ""}`;
}

function part(text: string): string {
  return encodeURIComponent(text);
}

/** The cloud's REST interface, by the session's cookie. */
export class Client {
  constructor(private readonly options: ClientOptions) {}

  nodes(signal: AbortSignal): Promise<NodeItem[]> {
    return this.all<NodeItem>("/nodes", {}, signal).then((list) => list.items);
  }

  gateways(signal: AbortSignal): Promise<GatewayItem[]> {
    return this.all<GatewayItem>("/gateways", {}, signal).then((list) => list.items);
  }

  storage(signal: AbortSignal): Promise<StorageAnswer> {
    return this.get(address("/storage"), signal);
  }

  /** Channels of a node: all, or those whose names contain a text. */
  channels(node: string, signal: AbortSignal, text?: string): Promise<ChannelItem[]> {
    return this.all<ChannelItem>(`/nodes/${part(node)}/channels`, { text }, signal).then((list) => list.items);
  }

  /** What the frames of a node are read by, named by its hash. */
  layout(node: string, hash: string, signal: AbortSignal): Promise<LayoutItem> {
    return this.get(address(`/nodes/${part(node)}/layouts/${part(hash)}`), signal);
  }

  /** Pictures of a node's skin, at most `points`, as a CBOR sequence of frames. */
  async frames(node: string, query: FilmQuery, signal: AbortSignal): Promise<Uint8Array> {
    const answer = await this.send(address(`/nodes/${part(node)}/frames`, { ...query }), "application/cbor-seq", signal);
    return new Uint8Array(await answer.arrayBuffer());
  }

  /** Contacts of a node in a window, at most so many statements. */
  contacts(node: string, window: { start: Instant; end: Instant; points: number }, signal: AbortSignal): Promise<ContactsItem[]> {
    return this.all<ContactsItem>("/contacts", { node, ...window }, signal).then((list) => list.items);
  }

  /** Gestures on a node's skin that are certain or possible in a window, of a few seconds: the cloud recognises them anew. */
  gestures(node: string, window: { start: Instant; end: Instant }, signal: AbortSignal): Promise<GestureItem[]> {
    return this.all<GestureItem>(`/nodes/${part(node)}/gestures`, { ...window }, signal).then((list) => list.items);
  }

  /** The monitors that run on a node, with their latest verdicts and outputs. */
  nodeMonitors(node: string, signal: AbortSignal): Promise<NodeMonitorItem[]> {
    return this.all<NodeMonitorItem>(`/nodes/${part(node)}/monitors`, {}, signal).then((list) => list.items);
  }

  command(node: string, id: number, signal: AbortSignal): Promise<CommandItem> {
    return this.get(address(`/nodes/${part(node)}/commands/${id}`), signal);
  }

  state(node: string, signal: AbortSignal): Promise<NodeState> {
    return this.get(address(`/nodes/${part(node)}/state`), signal);
  }

  series(
    target: ChannelRef,
    window: { start: Instant; end: Instant; points: number },
    signal: AbortSignal,
  ): Promise<SeriesAnswer> {
    return this.get(address(`/series/${part(target.node)}/${part(target.channel)}`, window), signal);
  }

  /** The segments of a window in which a threshold is passed; `complete` is false if there were too many. */
  threshold(
    target: ChannelRef,
    query: ThresholdQuery,
    signal: AbortSignal,
  ): Promise<{ items: VerdictItem[]; complete: boolean }> {
    return this.all(`/series/${part(target.node)}/${part(target.channel)}/threshold`, { ...query }, signal);
  }

  /** For how long a threshold is passed in a window. */
  thresholdTime(target: ChannelRef, query: ThresholdQuery, signal: AbortSignal): Promise<TotalsAnswer> {
    return this.get(address(`/series/${part(target.node)}/${part(target.channel)}/time`, { ...query }), signal);
  }

  /** When a formula holds, may hold, and does not; `complete` is false if there were too many stretches. */
  verdicts(query: WindowedFormula, signal: AbortSignal): Promise<{ items: VerdictItem[]; complete: boolean }> {
    return this.all("/monitors/evaluation", { ...query }, signal);
  }

  /** For how long a formula holds in a window, and how often verdicts are false. */
  verdictTime(query: WindowedFormula, signal: AbortSignal): Promise<FormulaTotalsAnswer> {
    return this.get(address("/monitors/evaluation/time", { ...query }), signal);
  }

  models(signal: AbortSignal): Promise<ModelItem[]> {
    return this.all<ModelItem>("/models", {}, signal).then((list) => list.items);
  }

  prediction(
    target: ChannelRef,
    query: PredictionQuery & { points: number },
    signal: AbortSignal,
  ): Promise<PredictionAnswer> {
    return this.get(address(`/series/${part(target.node)}/${part(target.channel)}/prediction`, { ...query }), signal);
  }

  /** When a channel is not what a model predicts; `complete` is false if there were too many segments. */
  anomalies(
    target: ChannelRef,
    query: PredictionQuery,
    signal: AbortSignal,
  ): Promise<{ items: VerdictItem[]; complete: boolean }> {
    return this.all(`/series/${part(target.node)}/${part(target.channel)}/anomalies`, { ...query }, signal);
  }

  anomaliesTime(
    target: ChannelRef,
    query: PredictionQuery,
    signal: AbortSignal,
  ): Promise<TotalsAnswer> {
    return this.get(address(`/series/${part(target.node)}/${part(target.channel)}/anomalies/time`, { ...query }), signal);
  }

  events(query: EventQuery, signal: AbortSignal): Promise<Page<EventItem>> {
    return this.get(address("/events", { ...query, order: "desc" }), signal);
  }

  /** The latest events that a question finds, over several pages at most; `complete` is false if there are more. */
  async eventsOf(query: EventQuery, pages: number, signal: AbortSignal): Promise<{ items: EventItem[]; complete: boolean }> {
    const items: EventItem[] = [];
    let cursor: string | undefined;
    for (let page = 0; page < pages; page += 1) {
      // Each page's address comes with the page before it.
      // oxlint-disable-next-line no-await-in-loop
      const answer = await this.events({ ...query, limit: EVENTS_AT_ONCE, cursor }, signal);
      items.push(...answer.items);
      if (answer.next === null) return { items, complete: true };
      cursor = answer.next;
    }
    return { items, complete: false };
  }

  /** The alarms that are raised now, the latest first. */
  raisedAlarms(signal: AbortSignal): Promise<AlarmItem[]> {
    return this.all<AlarmItem>("/alarms", { state: "raised" }, signal).then((list) => list.items);
  }

  monitors(signal: AbortSignal): Promise<MonitorItem[]> {
    return this.all<MonitorItem>("/monitors", {}, signal).then((list) => list.items);
  }

  async acknowledge(alarm: number): Promise<void> {
    await this.change("POST", `/alarms/${alarm}/acknowledgement`);
  }

  async silence(monitor: string, seconds: number): Promise<void> {
    await this.change("PUT", `/monitors/${part(monitor)}/silence`, { seconds });
  }

  async defineMonitor(name: string, definition: MonitorDefinition): Promise<void> {
    await this.change("PUT", `/monitors/${part(name)}`, definition);
  }

  async deleteMonitor(name: string): Promise<void> {
    await this.change("DELETE", `/monitors/${part(name)}`);
  }

  async logout(): Promise<void> {
    await this.options.fetch("/logout", { method: "POST", credentials: "same-origin", redirect: "manual" });
  }

  private async all<Item>(
    path: string,
    query: Query,
    signal: AbortSignal,
  ): Promise<{ items: Item[]; complete: boolean }> {
    const items: Item[] = [];
    let cursor: string | null = null;
    for (let page = 0; page < MOST_PAGES; page += 1) {
      // Each page's address comes with the page before it.
      // oxlint-disable-next-line no-await-in-loop
      const answer: Page<Item> = await this.get(address(path, { ...query, cursor }), signal);
      items.push(...answer.items);
      cursor = answer.next;
      if (cursor === null || cursor === undefined) return { items, complete: true };
    }
    return { items, complete: false };
  }

  private async get<Answer>(path: string, signal: AbortSignal): Promise<Answer> {
    const answer = await this.send(path, "application/json", signal);
    return (await answer.json()) as Answer;
  }

  private async change(method: string, path: string, body?: object): Promise<void> {
    const headers = { "Content-Type": "application/json" };
    const written = body === undefined ? {} : { headers, body: JSON.stringify(body) };
    await this.send(address(path), "application/json", AbortSignal.timeout(CHANGE_MS), { method, ...written });
  }

  private async send(path: string, accept: string, signal: AbortSignal, how: RequestInit = {}): Promise<Response> {
    let answer: Response;
    try {
      const headers = { Accept: accept, ...how.headers };
      answer = await this.options.fetch(path, { ...how, headers, credentials: "same-origin", signal });
    } catch (error) {
      if (isAbort(error)) throw error;
      throw new ApiError("The cloud cannot be reached. Check the network and that the cloud is running.", null);
    }
    if (answer.status === 401) {
      this.options.onUnauthorised();
      throw new ApiError("The session is over. Sign in again.", 401);
    }
    if (!answer.ok) throw await ApiError.fromAnswer(answer, path);
    return answer;
  }
}
