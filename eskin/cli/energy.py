"""``eskin energy``: what a node spends and harvests, and whether it sustains itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eskin.errors import SettingsError

if TYPE_CHECKING:
    from eskin_sensor_node.tools.budget import Budget, NodeDesign

    from eskin.interval import Interval

Named = Annotated[
    str | None,
    typer.Option("--profile", help="A packaged profile, such as paper-hand, the paper's."),
]
Config = Annotated[Path | None, typer.Option(help="TOML file with a node's settings.")]
Seconds = Annotated[
    int | None,
    typer.Option(min=1, max=86_400, help="Emulated seconds to run, else 20."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: bounds in W, as [lo, hi].")]


def energy(
    profile: Named = None, config: Config = None, seconds: Seconds = None, as_json: AsJson = False
) -> None:
    """Tell what a node spends and harvests in each mode, from its firmware really running."""
    from eskin_sensor_node.tools.budget import NodeDesign
    from eskin_sensor_node.tools.budget.design import SECONDS

    if (profile is None) == (config is None):
        raise SettingsError("--profile", "give either --profile NAME or --config FILE.toml")
    design = NodeDesign.read(config) if config is not None else NodeDesign.named(str(profile))
    budgets = _measure(design, SECONDS if seconds is None else seconds)
    text = _json(budgets) if as_json else _table(budgets)
    typer.echo(text)


def _measure(design: NodeDesign, seconds: int) -> list[Budget]:
    from eskin_sensor_node.tools.budget import Budget
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("running the firmware", total=seconds * len(design.modes))
        return [
            Budget.measure(design, mode, seconds, lambda passed: bar.advance(task, passed))
            for mode in design.modes
        ]


def _rows(budgets: list[Budget]) -> list[tuple[str, list[Interval]]]:
    """Name and an interval for each mode."""
    rows = [(part, [each.spent[part] for each in budgets]) for part in budgets[0].spent]
    rows.append(("consumption", [each.consumption for each in budgets]))
    rows += [(part, [each.harvest[part] for each in budgets]) for part in budgets[0].harvest]
    rows.append(("½CV² in the sensors", [each.filled for each in budgets]))
    return rows


def _table(budgets: list[Budget]) -> str:
    from eskin_sensor_node.tools.budget import conditions, saving

    design = budgets[0].design
    lines = [
        f"{design.name}: {design.description}",
        f"{design.taxels} taxels, {budgets[0].seconds} s, mean power:",
        "",
        f"{'':<20}" + "".join(f"{each.mode:>25}" for each in budgets),
    ]
    for name, values in _rows(budgets):
        lines.append(f"{name:<20}" + "".join(f"{_watts(value):>25}" for value in values))
    verdicts = "".join(f"{_VERDICTS[each.verdict.name]:>25}" for each in budgets)
    lines += [f"{'self-sustaining':<20}{verdicts}", "", "The verdict holds where"]
    lines += [f"- {condition}" for condition in conditions(design.settings)]
    lines.append("")
    for frugal in budgets[1:]:
        watts, share = saving(budgets[0], frugal)
        lines.append(f"{frugal.mode} saves {_watts(watts)}, {share * 100.0:.1f} %")
    return "\n".join(lines)


_SCALES = ((1.0, "W"), (1e3, "mW"), (1e6, "µW"), (1e9, "nW"))
_VERDICTS = {"CERTAIN": "certainly", "POSSIBLE": "possibly", "IMPOSSIBLE": "not"}


def _watts(power: Interval) -> str:
    """Bounds in the unit that fits, rounded outward to three places."""
    greatest = max(abs(float(power.inf)), abs(float(power.sup)))
    factor, unit = next((each for each in _SCALES if greatest * each[0] >= 1.0), _SCALES[-1])
    return f"{power * factor:.3f} {unit}"


def _json(budgets: list[Budget]) -> str:
    from eskin_sensor_node.tools.budget import conditions, saving

    modes: dict[str, Any] = {}
    for k, each in enumerate(budgets):
        modes[each.mode] = {
            "power_W": {name: _bounds(values[k]) for name, values in _rows(budgets)},
            "verdict": each.verdict.name.lower(),
            "work": each.work._asdict(),
        }
    for each in budgets[1:]:
        watts, share = saving(budgets[0], each)
        modes[each.mode]["saving"] = {"power_W": _bounds(watts), "share": _bounds(share)}
    design = budgets[0].design
    return json.dumps(
        {
            "design": design.name,
            "taxels": design.taxels,
            "seconds": budgets[0].seconds,
            "conditions": conditions(design.settings),
            "modes": modes,
        },
        indent=2,
        ensure_ascii=False,
    )


def _bounds(value: Interval) -> list[float]:
    return [float(value.inf), float(value.sup)]
