"""The node of a large skin without its network: machine, columns, clock, flash and truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.interval import Verdict
from eskin.wire.messages import Position
from eskin_sensor_node.firmware import states
from eskin_sensor_node.firmware.assembler import Assembler
from eskin_sensor_node.firmware.gap_reasons import DEAD, STUCK, reason_text
from eskin_sensor_node.firmware.schedule import Frame
from eskin_sensor_node.machine.prices import NONE, message
from eskin_sensor_node.machine.prices import stretch as price_stretch
from eskin_sensor_node.machine.sampling import WHOLE_FRAME, SamplingInterrupts
from eskin_sensor_node.node.base import BaseNode
from eskin_sensor_node.node.ground_truth import TrueFrame
from eskin_sensor_node.node.reflexes import NodeReflexes
from eskin_sensor_node.node.self_test import SELF_TEST_WINDOW
from eskin_sensor_node.skin_node.frames import FrameWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_sensor_node.columns.stretch import SkinColumns, SkinStretch
    from eskin_sensor_node.firmware.message_writer import Gap, Record
    from eskin_sensor_node.firmware.outbox import Batch, Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import NodeSettings

_MOST_GAPS: Final = 500
"""In one message, which holds 64 KiB."""


class SkinNode(BaseNode):
    """Samples a skin into flash, a frame for each page and stretch.

    Args:
        settings: The node's settings.
        clock: Its clock.
        outbox: Takes its messages; its boot number is this run's.
        truth: The ground truth, for the audit.
        seed: Draws what a reset makes new.
        build: Makes the columns of a boot, by its number.

    Attributes:
        columns: The taxels.
        reflexes: Its monitors.
    """

    def __init__(
        self,
        settings: NodeSettings,
        *,
        clock: Clock,
        outbox: Outbox,
        truth: GroundTruth,
        seed: int,
        build: Callable[[int], SkinColumns],
    ) -> None:
        super().__init__(settings, clock=clock, outbox=outbox, truth=truth, seed=seed)
        self._build = build
        self._neighbours = settings.skin.skin.neighbours.shape[1]
        self._boot()

    def _boot_sampling(self) -> None:
        self.columns = self._build(self._outbox.boot)
        self._layout = self.columns.layout.content_hash
        self._frame_writer = FrameWriter(self.columns.layout, self.columns.patches)
        patches = enumerate(self.columns.patches)
        self._patch_of = {taxel: number for number, patch in patches for taxel in patch.taxels}
        self._tested = 0
        self._rows_untested = 0
        self._broken: frozenset[str] = frozenset()
        self._assembler = Assembler(self._clock.known, self._outbox.message_writer)
        self._sampling = SamplingInterrupts(self.machine, [self._sample], WHOLE_FRAME)
        self.reflexes = NodeReflexes(
            self._settings,
            self.columns.taxels,
            machine=self.machine,
            sampling=self._sampling,
            clock=self._clock.known,
            assembler=self._assembler,
            gesture_key=self.gesture_key,
        )
        self._arm()

    @property
    def _sampling_due(self) -> int:
        return self._sampling.due

    def _arm_sampling(self) -> None:
        self._sampling.arm(0, self.columns.frame)
        self.reflexes.arm()

    def _stop_sampling(self) -> None:
        self._sampling.stop()
        self.reflexes.stop()

    def _next_start(self) -> tuple[int, int]:
        return self.columns.next_start, self.columns.next_start

    def _missing(self, ticks: int) -> int:
        return self.columns.skip(ticks)

    def _skip(self, batch: Batch, ticks: int) -> int:
        batch.take(self._assembler.flush())
        return self.columns.skip(ticks)

    def _undecided(self) -> Sequence[Record]:
        return self._assembler.flush()

    def _set_shedding(self, stage: int) -> None:
        """Only deep sleep saves energy here: it searches no peaks."""

    def _sample(self) -> None:
        """Handle the interrupt at the end of a stretch."""
        self.states.take(states.DUE, self._ticks)
        self._sampling.complete(0)
        stretches = self._work_off(lambda: list(self.columns.advance(self._ticks)))
        if stretches is None:
            return
        for stretch in stretches:
            self._finish(stretch)
        for record in self._assembler.flush():
            self.machine.ledger.charge_message(message(len(record.body)), len(record.body))
            self._batch.take([record])
        self._arm()

    def _finish(self, stretch: SkinStretch) -> None:
        """Charge and store a stretch."""
        clock, ledger = self._clock, self.machine.ledger
        lasting = stretch.end - stretch.begin
        begin, end = clock.true_time(stretch.begin), clock.true_time(stretch.end)
        frames = self._frame_writer.write(stretch, clock.known, self._outbox.message_writer)
        written = []
        for record, sizes, values in frames:
            written.append(len(record.body))
            ledger.charge_message(NONE, len(record.body))
            self._batch.take([record])
            position = Position(self._outbox.boot, record.sequence)
            true = TrueFrame(
                position, self._layout, stretch.begin, lasting, begin, end, sizes, values
            )
            self._true.append(true)
        self._charge(stretch, written)
        self._batch.take(self._test(stretch))

    def _charge(self, stretch: SkinStretch, sizes: Sequence[int]) -> None:
        """Charge a stretch; ``sizes``: bytes of its frames."""
        skin, machine = self._settings.skin, self._settings.machine
        for number, grid in enumerate(stretch.grids):
            taxels = sum(each.lo.shape[1] for each in stretch.patches if each.grid == number)
            cycles = price_stretch(
                machine.processor,
                skin.taxel.chain,
                taxels=taxels,
                rows=grid.rows,
                neighbours=self._neighbours,
                along=[each.chain for each in skin.air.values()],
                sizes=sizes if number == 0 else (),
            )
            start = stretch.begin + grid.delay
            frame = Frame(grid.first_row, start, 0, grid.rows, grid.period, start, closes=False)
            self.machine.ledger.charge_frame(
                frame, cycles=cycles.total, inputs=taxels + len(skin.air)
            )

    def _test(self, stretch: SkinStretch) -> list[Record]:
        """After a window of the self-test, state which taxels are broken, and were in it."""
        self._rows_untested += max(grid.rows for grid in stretch.grids)
        if stretch.end - self._tested < SELF_TEST_WINDOW:
            return []
        known = self._clock.known
        time = known.enclosure(self._tested)[0], known.enclosure(stretch.end)[1]
        found = {
            taxel: DEAD if dead == Verdict.CERTAIN else STUCK
            for taxel, dead, stuck in self.columns.examine()
            if Verdict.CERTAIN in (dead, stuck)
        }
        before, self._broken = self._broken, frozenset(found)
        # From the end of the window that shows it, a taxel's samples are unknown.
        gaps: list[Gap] = [
            (
                reason_text(found[taxel], taxel),
                time,
                0,
                self._rows_untested if taxel in before else 0,
                (),
                (self._patch_of[taxel],),
            )
            for taxel in sorted(found)
        ]
        self._tested, self._rows_untested = stretch.end, 0
        statements = self._outbox.message_writer.statements
        return [
            statements(time, gaps=gaps[k : k + _MOST_GAPS]) for k in range(0, len(gaps), _MOST_GAPS)
        ]
