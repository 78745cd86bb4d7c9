"""Making a dataset."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from eskin_sensor_node.tools.dataset.card import SCENARIO, card
from eskin_sensor_node.tools.dataset.columns import schema
from eskin_sensor_node.tools.dataset.run import Run
from eskin_sensor_node.tools.dataset.split import Split
from eskin_sensor_node.world.scenario.file import scenario_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin_sensor_node.tools.dataset.plan import Plan


def write_dataset(
    plan: Plan, out: Path, *, licence: str, progress: Callable[[int, int], None]
) -> list[Path]:
    """Write train and test, each as Parquet and CSV, the scenario and the data card.

    Args:
        plan: What is made.
        out: Folder for the files; made if missing.
        licence: As the card shall name it.
        progress: Called after each piece with the samples done, and with all.

    Returns:
        The files.

    Raises:
        OSError: They cannot be written; no half of them is left then.
    """
    out.mkdir(parents=True, exist_ok=True)
    total = len(plan.seconds) * (len(plan.train) + len(plan.test))
    done = 0
    with ExitStack() as stack:
        splits = {
            name: stack.enter_context(Split(out, name, schema(plan.quantities)))
            for name in ("train", "test")
        }
        for name, seeds in (("train", plan.train), ("test", plan.test)):
            for seed in seeds:
                for batch in Run(plan, seed).batches():
                    splits[name].write(batch)
                    done += batch.num_rows // len(plan.pads)
                    progress(done, total)
    files = [file for split in splits.values() for file in split.files]
    texts = {SCENARIO: scenario_text(plan.scenario), "README.md": card(plan, splits, licence)}
    for name, text in texts.items():
        (out / name).write_text(text, "utf-8", newline="\n")
        files.append(out / name)
    return files
