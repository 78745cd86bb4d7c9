"""The data card: what a dataset holds, and how it was made."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.tools.dataset.columns import schema
from eskin_sensor_node.tools.dataset.split import fingerprint
from eskin_sensor_node.world.scenario import LABELS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.tools.dataset.plan import Plan
    from eskin_sensor_node.tools.dataset.split import Split

SCENARIO: Final = "scenario.toml"

_TEXT: Final = """\
# {description}

A labelled dataset of an emulated sensor skin. Every measured value is an interval `[lo, hi]`, and
the truth stands beside it. One row is one taxel at one instant; rows are ordered by run, time and
taxel.

- **Licence:** {licence}
- **Skin:** {taxels} taxels on {area:.6g} cm², shape `{shape}`, crosstalk at most {crosstalk:g}
- **Runs:** {train} to learn from (seeds {train_seeds}), {test} to test with (seeds {test_seeds});
  {duration:g} s each at {rate:g} Hz; no seed is in both
- **Made by:** `eskin export`, eskin {eskin}, numpy {numpy}, pyarrow {pyarrow}, Python {python}. The
  same versions, scenario and seeds give the same bytes.
- **No personal data:** everything is computed; no person and no device was recorded.

## How it was made

For each run, a seed draws the variations of [{scenario}]({scenario}) (when and how strongly things
touch), the true parts of each taxel from inside their tolerances, and the noise. The emulated
analogue chains (Fig. 3 of the paper) turn capacitance and inductance into ADC codes; the intervals
are calculated from codes and data sheets alone, by the arithmetic of a node's firmware.
Temperature, humidity and the body's voltage go through chains of their own, one of each in a run,
which all taxels read along. A single interval holds the truth with a probability of
at least {coverage!r}.

For the whole run of a taxel that breaks in it, pressure, contact area and distance state no more
than the data sheet. A saturated converter leaves a side unbounded (`inf`, `-inf`).

## Files

| file | rows | SHA-256 |
|---|---|---|
{files}

## Labels

| label | train | test |
|---|---|---|
{labels}

## Columns

| column | type | unit (UCUM) | what it is |
|---|---|---|---|
{columns}

## Data sheets

Pads: {pad}

Coils: {coil}

Thermometer: {thermometer}

Hygrometer: {hygrometer}

Electrode: {electrode}
"""


def card(plan: Plan, splits: Mapping[str, Split], licence: str) -> str:
    """The card as Markdown."""
    skin = plan.script.skin.build()
    return _TEXT.format(
        description=plan.script.description,
        licence=licence,
        taxels=len(skin),
        area=skin.area * 1e4,
        shape=plan.script.skin.shape,
        crosstalk=plan.script.skin.crosstalk,
        train=len(plan.train),
        test=len(plan.test),
        train_seeds=_span(plan.train),
        test_seeds=_span(plan.test),
        duration=plan.script.duration_s,
        rate=plan.rate,
        **{name: version(name) for name in ("eskin", "numpy", "pyarrow")},
        python=platform.python_version(),
        scenario=SCENARIO,
        coverage=plan.coverage,
        files="\n".join(_files(splits)),
        labels="\n".join(
            f"| {label} | {splits['train'].labels[label]} | {splits['test'].labels[label]} |"
            for label in LABELS
        ),
        columns="\n".join(_columns(plan)),
        pad=_sheet(plan.pads[:1]),
        coil=_sheet(plan.coils[:1]),
        thermometer=_sheet((plan.thermometer,)),
        hygrometer=_sheet((plan.hygrometer,)),
        electrode=_sheet((plan.electrode,)),
    )


def _span(seeds: tuple[int, ...]) -> str:
    return f"{seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"{seeds[0]}"


def _files(splits: Mapping[str, Split]) -> Iterator[str]:
    for split in splits.values():
        for file in split.files:
            yield f"| {file.name} | {split.rows} | `{fingerprint(file)}` |"


def _columns(plan: Plan) -> Iterator[str]:
    for field in schema(plan.quantities):
        meta = {key.decode(): value.decode() for key, value in field.metadata.items()}
        yield f"| `{field.name}` | {field.type} | {meta['unit']} | {meta['meaning']} |"


def _sheet(taxels: Sequence[TaxelSection]) -> str:
    """The keys of a data sheet, as they would stand in a profile."""
    if not taxels:
        return "none."
    keys = taxels[0].model_dump(by_alias=True, exclude={"id", "place", "scenario"})
    return ", ".join(f"`{key} = {value!r}`" for key, value in keys.items()) + "."
