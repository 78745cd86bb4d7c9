from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sensor_node.firmware.inversion import measure_neighbour
from sensor_node.firmware.inversion.air import UNUSED
from sensor_node.firmware.schedule import Frame
from sensor_node.firmware.taxel import CHAINS
from sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from sensor_node.machine.ledger import CLOCK_HZ, OPERATIONS, Ledger
from sensor_node.machine.machine import START_UP
from sensor_node.machine.sheet import data_sheet
from tests.sensor_node.designs import KINDS, SECOND, Bench, taxel
from tests.sensor_node.machine.counting import Counted

if TYPE_CHECKING:
    from pathlib import Path


def operations(kind: str, share: float) -> int:
    """What the firmware does with one sample, by counting it."""
    made = taxel(kind)
    sheet = data_sheet(made)
    if "pressure_max" in sheet:
        sheet["pressure_max"] = Counted(sheet["pressure_max"])
    firmware = CHAINS[made.chain](sheet)
    code = Counted(int(share * (1 << made.adc_bits)))
    Counted.done = 0
    bounds = [[0.0] for _ in range(2 * len(firmware.quantities))]
    firmware.measure([[code] for _ in firmware.inputs], 1, bounds)  # type: ignore[list-item]  # counts
    firmware.separate(1, bounds, ())
    return Counted.done


def counted(*values: float) -> list[float]:
    return [Counted(value) for value in values]


def of_the_air(*, known: bool) -> int:
    """What a pad does with one code of a sensor that it reads along, besides its inversion."""
    code = Counted(2000.0)
    memory = [2000 if known else UNUSED], counted(-1e-3), counted(1e-3)
    sheet = data_sheet(taxel("hygrometer"))
    sensor = HygrometerTaxel(sheet)
    Counted.done = 0
    sensor.change([code], 1, 1e-3, memory, counted(1.0), counted(1.0))  # type: ignore[list-item, arg-type]  # counts
    return Counted.done


def of_a_neighbour() -> int:
    felt = counted(100.0), counted(300.0)
    Counted.done = 0
    measure_neighbour(1, 2e4, *felt, counted(0.0), counted(2e4))
    return Counted.done


def test_operations_of_each_chain_are_those_that_its_inversion_does() -> None:
    most = dict.fromkeys(OPERATIONS, 0)
    most["neighbour"], most["remembered"] = of_a_neighbour(), of_the_air(known=True)
    for kind in KINDS:
        counts = [operations(kind, share) for share in (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98)]
        chain = taxel(kind).chain
        most[chain] = max(most[chain], *counts)
    most["new"] = (
        of_the_air(known=False) - most["remembered"] - operations("hygrometer", 2000 / 4096)
    )
    assert most == OPERATIONS


def test_a_span_holds_no_more_than_its_time_and_the_rest_goes_into_the_next() -> None:
    ledger = Ledger()
    ledger.charge_hang(3 * SECOND)
    ledger.charge_off(SECOND)
    first, second = ledger.take(2 * SECOND), ledger.take(5 * SECOND)
    assert (first.span, first.asleep, first.instructions) == (2 * SECOND, 0, 3 * CLOCK_HZ)
    assert (second.span, second.asleep, second.instructions) == (3 * SECOND, SECOND, 0)


def test_fast_burst_leaves_no_time_to_sleep_between_samples() -> None:
    ledger = Ledger()
    frame = Frame(0, 0, 0, 0, 250, 10_000, closes=False)
    ledger.charge_frame(frame, operations=250 * OPERATIONS["hybrid"], inputs=2, channels=2)
    assert ledger.take(frame.end).asleep == 0


@pytest.mark.parametrize("profile", ["fingertip", "palm", "forearm", "hand"])
def test_node_sleeps_deeply_between_samples_and_counts_what_it_did(
    profile: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, profile)
    bench.run_to(4.0)
    work = bench.node.machine.ledger.take(4 * SECOND)
    samples = {taxel.name: 0 for taxel in bench.node.taxels}
    for each in bench.node.taxels:
        samples[each.name] = each.control_unit.schedule.before(each.next.start) * each.inputs
    assert work.conversions == sum(samples.values())
    assert work.span == 4 * SECOND
    assert 0 < work.instructions < 4 * CLOCK_HZ
    assert 0.05 < work.asleep / work.span < 1.0
    bench.close()


def test_time_without_power_is_not_sleep(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    ledger, machine = bench.node.machine.ledger, bench.node.machine
    bench.node.shed("ordered")
    machine.events.at(SECOND, lambda: machine.reset(machine.cause))
    machine.events.at(SECOND + START_UP + 1, lambda: bench.node.shed("ordered"))
    bench.run_to(2.0)
    assert ledger.take(2 * SECOND).asleep == 2 * SECOND - START_UP
    bench.close()
