"""What the data sheets of a node's supply say: ``[energy]`` of its settings."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from eskin.runtime.settings import Section

_TOLERANCE = "relative; the true one lies anywhere inside"


def _positive(default: float, description: str) -> float:
    value: float = Field(default=default, gt=0, lt=1e12, description=description)
    return value


def _part(default: float) -> float:
    value: float = Field(default=default, ge=0, lt=0.5, description=_TOLERANCE)
    return value


def _wide(default: float) -> float:
    value: float = Field(default=default, ge=0, lt=1, description=_TOLERANCE)
    return value


class EnergySection(Section):
    """A node that lives on a supercapacitor and on what touches give; see docs/energy.md."""

    on: bool = Field(default=False, description="whether the node lives on its supercapacitor")
    horizon_s: float = Field(
        default=20.0, gt=0, le=86_400, description="seconds over which the verdict is given"
    )
    capacitance: float = _positive(0.1, "of the hybrid supercapacitor, F")
    capacitance_tolerance: float = _part(0.1)
    series_resistance: float = _positive(1.0, "of the supercapacitor (ESR), Ω")
    series_resistance_tolerance: float = _part(0.3)
    leakage_resistance: float = _positive(4e6, "of the supercapacitor, Ω")
    leakage_resistance_tolerance: float = _part(0.4)
    start_voltage: float = _positive(3.5, "at the first start, V")
    rated_voltage: float = _positive(3.8, "at which a shunt takes what comes more, V")
    restart_voltage: float = _positive(2.6, "at which a machine that stopped starts again, V")
    brown_out_voltage: float = _positive(2.2, "below which the machine stops, V")
    adc_bits: int = Field(default=12, ge=4, le=24, description="of the supply's converter")
    adc_max: float = _positive(4.0, "end of the supply's converter, V")
    adc_gain_error: float = _part(1e-3)
    adc_offset_error: float = Field(default=1.0, ge=0, le=1000, description="in steps")
    adc_nonlinearity: float = Field(default=0.5, ge=0, le=1000, description="INL, in steps")
    active_current: float = _positive(3e-4, "drawn while the supply is measured, A")
    active_current_tolerance: float = _part(0.3)
    cycle: float = _positive(
        9.6e-11,
        "energy of a cycle of the processor, J: STM32U575's 19.5 µA/MHz at 3.3 V, to twice that",
    )
    cycle_tolerance: float = _part(0.35)
    conversion: float = _positive(
        3e-9,
        "energy of a conversion, J: 3 V times ISAADC0, 1.4 mA at 2 million a second (nRF54L15) to "
        "1.3 mA at 1 million (nRF54LS05A; Nordic, tables of SAADC active)",
    )
    conversion_tolerance: float = _part(0.3)
    sent: float = _positive(
        3e-7,
        "energy of a byte sent, J: nRF52840's 4.8 mA at 3 V for 8 µs, and as much again and more",
    )
    sent_tolerance: float = _part(0.2)
    received: float = _positive(3e-7, "energy of a byte received, J; likewise")
    received_tolerance: float = _part(0.2)
    packet_loss: float = Field(
        default=0.1,
        ge=0,
        le=0.9,
        description="share of packets that is lost and sent again, at most, where a budget counts "
        "each once; a running node counts those of its radio",
    )
    listening: float = _positive(
        1.6e-5,
        "energy of a connection event without data, J: nRF52840's 4.6 to 4.8 mA at 3 V for 0.4 to "
        "1.5 ms (ramp, window, empty packets), and up to 5 µJ for its crystal and processor",
    )
    listening_tolerance: float = _wide(0.67)
    connection_interval_s: float = _positive(
        1.0, "seconds from one connection event to the next, with the events that a node skips"
    )
    handshake: float = _positive(
        1.45e-2,
        "energy of a TLS handshake with certificates on both sides, J: 5 to 200 million cycles "
        "(P-256 in assembly or in plain C; assumed) and 3 to 6 kB on the air",
    )
    handshake_tolerance: float = _wide(0.94)
    handshakes_a_day: float = Field(
        default=4.0, ge=0, le=86_400, description="TLS handshakes, at most; 0: none"
    )
    written: float = _positive(
        1.25e-6,
        "energy of a byte put into flash with its share of an erasure, J: at most 15 mA at 3 V, a "
        "page of 256 bytes in 1.4 to 5 ms, a sector of 4 KiB in 60 to 120 ms (Macronix KH25L8005), "
        "and a third of that current at least",
    )
    written_tolerance: float = _wide(0.77)
    sleeping: float = _positive(
        6.6e-6,
        "power in deep sleep, W: 3 V times 1.5 to 2.9 µA, nRF54L15 with its clock and 64 to 256 kB "
        "of RAM (Nordic, table of sleep, ION_IDLE6 to 8)",
    )
    sleeping_tolerance: float = _part(0.32)
    wake_up: float = _positive(6e-8, "energy of a wake-up from deep sleep, J (assumed)")
    wake_up_tolerance: float = _part(0.2)
    flash_resting: float = _positive(
        3e-6, "power of flash in deep power-down, W: 1 µA at 3 V (Macronix KH25L8005, typical)"
    )
    flash_resting_tolerance: float = _wide(0.7)
    sensor_voltage: float = _positive(0.5, "that the MOSFET switches to the sensor, V")
    sensor_voltage_tolerance: float = _part(0.02)
    pulse_s: float = _positive(1e-3, "for which it is switched on for a conversion, s")
    switch_resistance: float = _positive(1.0, "of the MOSFET that is on, Ω")
    coil_inductance: float = Field(
        default=0.0, ge=0, lt=1e3, description="of MagFES, H; 0: there is no coil"
    )
    coil_resistance: float = _positive(5.0, "of MagFES, Ω")
    sensor_capacitance: float = _positive(1e-9, "of EcFES, F")
    sensor_resistance: float = _positive(1e3, "before EcFES, Ω")
    sensor_tolerance: float = _part(0.1)
    piezo_coefficient: float = _positive(4e-10, "d33 of the piezoelectric layer, C/N")
    piezo_gain: float = _positive(
        10.0, "by which its mount strengthens a force; piezo_tolerance is of d33 with it"
    )
    piezo_capacitance: float = _positive(2e-8, "of a taxel's piezoelectric layer, F")
    piezo_tolerance: float = _part(0.2)
    tribo_charge: float = _positive(3e-5, "surface charge of the triboelectric layer, C/m²")
    tribo_gap_m: float = _positive(1e-3, "to which the layers separate, m")
    tribo_thickness_m: float = _positive(1e-5, "of the layer over its relative permittivity, m")
    tribo_tolerance: float = _part(0.2)
    harvest_efficiency: float = Field(
        default=0.4, gt=0, le=0.66, description="from a layer's charge to the supercapacitor"
    )
    harvest_efficiency_tolerance: float = _part(0.4)

    @model_validator(mode="after")
    def _voltages_rise(self) -> Self:
        if not self.brown_out_voltage < self.restart_voltage < self.rated_voltage <= self.adc_max:
            raise ValueError(
                "brown_out_voltage < restart_voltage < rated_voltage <= adc_max must hold, not "
                f"{self.brown_out_voltage} < {self.restart_voltage} < {self.rated_voltage} <= "
                f"{self.adc_max}"
            )
        if self.start_voltage > self.rated_voltage:
            raise ValueError(f"start_voltage = {self.start_voltage} is above rated_voltage")
        return self
