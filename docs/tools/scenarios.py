"""Scenarios as a page: ``python -m docs.tools.scenarios > docs/scenarios.md``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final, get_args

from eskin_sensor_node.world.replay import Recorded
from eskin_sensor_node.world.scenario import Script
from eskin_sensor_node.world.scenario.events import AnyEvent
from eskin_sensor_node.world.scenario.script import VariationSection
from eskin_sensor_node.world.scenario.surroundings import AmbientSection, BioelectricSection
from eskin_sensor_node.world.skin import (
    FaultSection,
    FilmSection,
    HysteresisSection,
    Shape,
    WearSection,
)

from docs.tools.keys_table import keys_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pydantic import BaseModel

_HEAD: Final = """\
# Scenarios, datasets and replay

A scenario is a TOML file that says what touches which taxel of a skin, when, and what surrounds
it. It drives the taxels of a node (`kind = "pad"`, `"coil"`, `"thermometer"`, `"hygrometer"` and
`"bioelectric"`, see [settings](settings.md); [quantities](quantities.md) says what they measure),
and `eskin export` makes labelled datasets of it.
eskin contains
[hand.toml](../sensor_node/eskin_sensor_node/scenarios/hand.toml), for the profile
[hand](../sensor_node/eskin_sensor_node/profiles/hand.toml), and
[walk.toml](../sensor_node/eskin_sensor_node/scenarios/walk.toml), for
[sole](../sensor_node/eskin_sensor_node/profiles/sole.toml) and
[sock](../sensor_node/eskin_sensor_node/profiles/sock.toml). For the large skins
[paper-hand](../sensor_node/eskin_sensor_node/profiles/paper-hand.toml) and
[small-hand](../sensor_node/eskin_sensor_node/profiles/small-hand.toml) there are
[paper-hand.toml](../sensor_node/eskin_sensor_node/scenarios/paper-hand.toml) (fingers tap, a ball
rolls over the palm, a grip holds) and
[small-hand.toml](../sensor_node/eskin_sensor_node/scenarios/small-hand.toml) (the hand at 5 mm). In
[wear.toml](../sensor_node/eskin_sensor_node/scenarios/wear.toml) pads wear, get wet and break.

Times count in seconds from the scenario's begin, places are names of taxels (`t00`, `t01`, …).
Keys end in their unit. What cannot be played is refused with one line: file, place, reason, as in
`my.toml: event 3 (slide).path: taxel 't99' is not there; the skin has t00 to t20`.

```toml
description = "two taps on a flat skin of 16 taxels"
duration_s = 5.0

[skin]
shape = "flat"
rows = 4
columns = 4
pitch_m = 0.01

[[event]]
kind = "tap"
at = "t05"
at_s = 1.0
duration_s = 0.1
times = 2
every_s = 1.0
force_N = 1.0
radius_m = 4e-3
```

## What happens to a taxel

- **Contacts** are round patches. With the course s of its force, which is 1 at most, a patch's
  area grows with `s^(2/3)` and its pressure with `s^(1/3)`, as Hertz has it; a tap is half a
  sine, a press a raised cosine, hold and slide have ramps. A taxel is covered by the area that
  the patch shares with a disc of the taxel's size.
- **Crosstalk**: a taxel feels its own mean pressure and `k` times the mean of its neighbours'.
  The true `k` of each taxel is drawn from 0 to `crosstalk`.
- **A pad** is two plates with an elastic layer between them, `d = d0 / (1 + p/E)` under the
  pressure p of a contact: it hardens as it gets thinner. Its capacitance is `C = C0·(1 + P/E)`,
  where P is the mean pressure that it feels, and its plates' mean distance `d0 / (1 + P/E)`.
  `C0 = ε0·εr·A/d0` follows the air by `1 + permittivity_per_K·(T - 20 °C) +
  permittivity_per_percent·(H - 50 %)`.
- **A pad that departs** from its data sheet: wear changes its d0 and E for good; hysteresis leaves
  of each contact a pressure R that fades, `C = C0·(1 + (P + R)/E)`, until its loop ends; water adds
  a share of C0; an open trace is a fault (`dead`). Capacitance and current still hold, and so does
  the plate distance of a dry pad. Pressure, contact area and what else is calculated back need not:
  [wear](wear.md) has what follows.
- **A coil** sees metal by `L = L0 - ΔL·e^(-αd)` (eq. 11 of the paper), and by eddy currents: with
  the metal's quality q its impedance changes by `ω·ΔL·e^(-αd)·(1/q - j)`, and with it the current
  that a fixed voltage drives through it, in amplitude and phase.
- **The air and the body** are the same for all: a `thermometer`, a `hygrometer` and a `bioelectric`
  taxel measure them.
- **Labels**: `noise` where nothing happens, else the kind of the contact that covers the taxel,
  or `approach` where metal is nearer than `reach_m`.

All of it follows from the seed. A node takes the scenario's own; `eskin export` one for each run.

## The file
"""

_TAIL: Final = """\
## Datasets

```sh
eskin export --scenario hand.toml --out DIR --runs 10 --test-runs 2 --seed 0 --rate 100
```

writes `train` and `test`, each as Parquet and CSV with the same rows, the scenario, and a data
card (`README.md`): columns, units, licence, how it was made, seeds, versions. One row is one taxel
at one instant: its label, and for each quantity the truth beside its interval. No seed is in both
parts; the same seeds and versions give the same bytes. All taxels of the skin have a pad, and a
coil where metal comes near; a thermometer, a hygrometer and an electrode are read along by all.
`[pad]`, `[coil]`, `[thermometer]`, `[hygrometer]` and `[electrode]` change their data sheets and
take the keys of these kinds in [settings](settings.md). Every code goes through the arithmetic of
the firmware, so that a dataset holds what nodes would have sent. Pressure, contact area and plate
distances are calculated back from the capacitances of all pads together, so that what neighbours
hand on is taken back.

## Replay

A taxel of `kind = "recorded_capacitance"` or `"recorded_inductance"` takes a file in the place of
physics, and measures it through its chain:

| column | what it is |
|---|---|
| `time` or `time_s`, or `time_ns` | seconds, or whole nanoseconds, rising in each channel |
| `channel` | any name |
| `value`, or `lo` and `hi` | what was recorded then; an unbounded side is `inf` or `-inf` |

Others are passed over. A file whose name ends in `.parquet` is Parquet, all others are CSV with a
header. NaN, times that stand twice or run backwards, and a file that ends in mid-line end the
replay there, with a line in the log that says file, place and reason; what stood before is
replayed. A gap (more than 1.5 periods without a sample) is logged and travels as one: where
nothing was recorded there is no sample, but a gap message, and no peak is joined across. A recorded
interval travels unshrunk: both its ends are measured, and what the node states encloses both; an
unbounded side stays unbounded.

## Stuck and dead taxels

A node looks for broken taxels in windows of 20 s: *dead* is certain where no sample of a window was
bounded, *stuck* where a taxel stayed still while the four nearest of its kind moved by more than
their uncertainty. It reports each as a gap event with the reason `t05 certainly stuck`. From then
on the taxel states what its line carries (capacitance, current, frequency, inductance), but no
cause of it (distances, areas, pressure), and its neighbours do not believe it; a gap a window
counts the samples that are left out. This ends with a window in which the fault is impossible.
What is only *possible* is sent with the node's status: of each taxel, whether it is certainly,
possibly or impossibly dead, and stuck. After a window without a touch all may be stuck.
The faults of a scenario (`[[fault]]`) are found at the end of the first whole window in which the
others move.

A node does not find out that a pad wears, is wet or remembers loads: its pressure goes on, and may
be wrong. `eskin audit` counts that as violations, and names the pads that leave their data sheets,
from when on and why. The dataset of such a scenario does not believe these pads, as it does not
believe broken ones.

## Adaptive control

The paper's G(t) follows stimulus and environment. With `adaptive = true` in a taxel's table, or by
the command `set` with `adaptive` (`on`, `off`), the control unit chooses after each frame how the
next one is measured; [settings](settings.md) has the keys.

- **Gain** (`gain_least` to `gain_most`): where codes come near an end of the converter's range, or
  would if they moved on as far as in this frame, it falls before the next frame; after four frames
  in which twice of it would fit with room, it doubles.
- **Trimmer** (`trimmer_steps`, `trimmer_step`): an offset taken away before the converter. It
  follows the drifting rest, and stays where something touches.
- **Plates** (`actuator_steps`, `actuator_step_m`; of `touch` and `pad`): they move apart where the
  gain is at its least and a touch still covers or presses too much, and back when it has gone.
  Between a pad's plates the layer swells: d0 is what it is at rest, and `d = d0 / (1 + p/E)` stays.

Each setting has its tolerance, belongs to a frame, and is part of the calculation: intervals
enclose the truth through every change, and a contact that stays is never trimmed away.

Stretches (`sampling.stretch_ms`) are what it reacts in. Within one, a sudden touch is caught
sample by sample: a sample-and-hold before the amplifier keeps what was sampled, and where its code
is at an end of the range, the firmware converts the same value again at once, up to three times,
with the gain and the step of the trimmer whose range goes on at that end and reaches farthest.
Neighbouring ranges overlap by all that their tolerances leave open, so that no value falls between
them; each sample is calculated back with the range that it was given. So no sample saturates that
the least gain and the trimmer reach in three steps, and what lies beyond them is reported as open,
until the plates have moved: by a step each frame. Two limits: samples that come too fast (the
hybrid's burst, every 10 µs) leave no time for it, and the gain alone does not help where the range
does not begin at 0 and a current falls below it. There a trimmer does. The profile hand leaves it
off: there the tolerances of parts, not the converter's steps, make the intervals of capacitance
wide.
"""


def page() -> str:
    """The whole page as Markdown."""
    return "\n".join([_HEAD, *_tables(), _TAIL])


def _tables() -> Iterator[str]:
    yield from keys_table("Top of the file", Script)
    for shape in get_args(get_args(Shape)[0]):
        yield from keys_table(f'`[skin]`, `shape = "{_constant(shape, "shape")}"`', shape)
    yield from keys_table("`[variation]`", VariationSection)
    yield from keys_table("`[ambient]`", AmbientSection)
    yield from keys_table("`[bioelectric]`", BioelectricSection)
    for event in get_args(AnyEvent):
        yield from keys_table(f'`[[event]]`, `kind = "{_constant(event, "kind")}"`', event)
    yield from keys_table("`[[fault]]`", FaultSection)
    yield from keys_table("`[[wear]]`", WearSection)
    yield from keys_table("`[[film]]`", FilmSection)
    yield from keys_table("`[hysteresis]`", HysteresisSection)
    yield from keys_table("`[[taxel]]` of a node that replays", Recorded)


def _constant(model: type[BaseModel], key: str) -> str:
    return str(get_args(model.model_fields[key].annotation)[0])


if __name__ == "__main__":
    sys.stdout.write(page())
