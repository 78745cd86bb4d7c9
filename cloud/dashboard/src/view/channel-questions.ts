import type { Answers } from "../chart/band-chart";
import { readInterval } from "../interval/interval";
import type { Question } from "../state/route";
import type { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { element } from "./element";
import { ModelForm } from "./model-form";
import { ThresholdForm } from "./threshold-form";

/** What may be asked of a channel that stands alone: one question at a time, whose answer its chart marks. */
export class ChannelQuestions {
  readonly root = element("div");
  private readonly threshold: ThresholdForm;
  private readonly model: ModelForm;

  constructor(context: Context, node: string, private readonly panel: ChannelPanel) {
    const { channel } = panel.data;
    const bounds = channel.bounds && readInterval(channel.bounds);
    const common = { context, node, channel: channel.id, unit: channel.unit, range: () => panel.range() };
    this.threshold = new ThresholdForm({
      ...common,
      magnitude: Math.max(0, ...[bounds?.lo ?? 0, bounds?.hi ?? 0].map(Math.abs).filter(Number.isFinite)),
      onSegments: (segments) => this.mark({ segments }),
    });
    this.model = new ModelForm({
      ...common,
      bounds,
      points: () => panel.width,
      onAnswer: (predicted, segments) => this.mark({ predicted, segments }),
    });
    this.root.append(this.threshold.root, this.model.root);
    this.apply(context.route().question);
  }

  apply(question: Question | null): void {
    const threshold = question?.kind === "threshold" ? question : null;
    const model = question?.kind === "model" ? question : null;
    if (this.panel.answers.threshold !== (threshold?.level ?? null)) this.mark({ threshold: threshold?.level ?? null });
    this.threshold.apply(threshold);
    this.model.apply(model);
  }

  frame(at: number): void {
    this.threshold.frame(at);
    this.model.frame(at);
  }

  private mark(answers: Partial<Answers>): void {
    this.panel.answers = { ...this.panel.answers, ...answers };
    this.panel.touch();
  }

  destroy(): void {
    this.threshold.destroy();
    this.model.destroy();
  }
}
