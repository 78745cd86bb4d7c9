import type { Answers } from "../chart/band-chart";
import type { Question } from "../state/route";
import type { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { element } from "./element";
import { FormulaForm } from "./formula-form";
import { ModelForm } from "./model-form";
import { ThresholdForm } from "./threshold-form";

/** So long (ms) the forms wait for the channel's first data, whose magnitude chooses the prefix of their inputs. */
const PATIENCE_MS = 3_000;

interface Forms {
  readonly threshold: ThresholdForm;
  readonly model: ModelForm;
  readonly formula: FormulaForm;
}

/** What may be asked of a channel that stands alone: one question at a time, whose answer its chart marks. */
export class ChannelQuestions {
  readonly root = element("div");
  private forms: Forms | null = null;
  private readonly since = performance.now();

  constructor(private readonly context: Context, private readonly node: string, private readonly panel: ChannelPanel) {}

  apply(question: Question | null): void {
    if (this.forms === null) return;
    const threshold = question?.kind === "threshold" ? question : null;
    const model = question?.kind === "model" ? question : null;
    const formula = question?.kind === "formula" ? question : null;
    if (this.panel.answers.threshold !== (threshold?.level ?? null)) this.mark({ threshold: threshold?.level ?? null });
    this.forms.threshold.apply(threshold);
    this.forms.model.apply(model);
    this.forms.formula.apply(formula);
  }

  frame(at: number): void {
    this.forms ??= this.make();
    this.forms?.threshold.frame(at);
    this.forms?.model.frame(at);
    this.forms?.formula.frame(at);
  }

  destroy(): void {
    this.forms?.threshold.destroy();
    this.forms?.model.destroy();
    this.forms?.formula.destroy();
  }

  private make(): Forms | null {
    const { context, node, panel } = this;
    const { channel, bounds } = panel.data;
    if (bounds === null && performance.now() - this.since < PATIENCE_MS) return null;
    const common = { context, node, channel: channel.id, unit: channel.unit, range: () => panel.range() };
    this.forms = {
      threshold: new ThresholdForm({
        ...common,
        magnitude: Math.max(0, ...[bounds?.lo ?? 0, bounds?.hi ?? 0].map(Math.abs).filter(Number.isFinite)),
        onSegments: (segments) => this.mark({ segments }),
      }),
      model: new ModelForm({
        ...common,
        bounds,
        points: () => panel.width,
        onAnswer: (predicted, segments) => this.mark({ predicted, segments }),
      }),
      formula: new FormulaForm({
        ...common,
        latest: () => (panel.data.extent === null ? null : context.timeline.toInstant(panel.data.extent.x1)),
        onStretches: (stretches) => {
          this.mark({ segments: stretches.filter(({ verdict, missing }) => verdict !== "impossible" && !missing) });
          panel.showVerdicts(stretches);
        },
      }),
    };
    this.root.append(this.forms.threshold.root, this.forms.model.root, this.forms.formula.root);
    this.apply(context.route().question);
    return this.forms;
  }

  private mark(answers: Partial<Answers>): void {
    this.panel.answers = { ...this.panel.answers, ...answers };
    this.panel.touch();
  }
}
