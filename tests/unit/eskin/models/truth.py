"""The models' formulas at single points, at 200 bits: what every interval is held against."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flint import arb, ctx

if TYPE_CHECKING:
    from collections.abc import Mapping

    Numbers = Mapping[str, Any]
    Found = dict[str, Any]

ctx.prec = 200


def sine(p: Numbers, frequency: str = "frequency") -> Any:
    return (2 * p[frequency] * p["time"]).sin_pi()


def cosine(p: Numbers, frequency: str = "frequency") -> Any:
    return (2 * p[frequency] * p["time"]).cos_pi()


def raised(p: Numbers, low: str, high: str) -> Any:
    s = (1 + sine(p)) / 2
    return p[low] + (p[high] - p[low]) * s


def permittivity(p: Numbers) -> Any:
    return p["vacuum_permittivity"] * p.get("relative_permittivity", 1)


def capacitance(p: Numbers) -> Found:
    return {"value": permittivity(p) * p["area"] / p["distance"]}


def moving_plate(p: Numbers) -> Found:
    d = raised(p, "minimum_distance", "maximum_distance")
    return {"distance": d, "capacitance": permittivity(p) * p["area"] / d}


def touch(p: Numbers) -> Found:
    a = raised(p, "minimum_area", "maximum_area")
    return {**touch_of_area({**p, "area": a}), "area": a}


def touch_of_area(p: Numbers) -> Found:
    c = permittivity(p) * p["area"] / p["distance"]
    return {"area": p["area"], "capacitance": c, "energy": c * p["voltage"] ** 2 / 2}


def coil_current(p: Numbers) -> Found:
    x = 2 * arb.pi() * p["frequency"] * p["inductance"]
    z = (p["resistance"] ** 2 + x**2).sqrt()
    return {"magnitude": p["voltage"] / z, "phase": -(x / p["resistance"]).atan()}


def lc_frequency(p: Numbers) -> Found:
    return {"value": 1 / (2 * arb.pi() * (p["inductance"] * p["capacitance"]).sqrt())}


def rc_frequency(p: Numbers) -> Found:
    return {"value": 1 / (2 * arb.pi() * p["resistance"] * p["capacitance"])}


def rc_frequency_paper(p: Numbers) -> Found:
    return {"value": 1 / (p["resistance"] * p["capacitance"])}


def harmonic_capacitance(p: Numbers) -> Found:
    return {"value": raised(p, "minimum_capacitance", "maximum_capacitance")}


def capacitive_chain(p: Numbers) -> Found:
    c = raised(p, "minimum_capacitance", "maximum_capacitance")
    f = 1 / (2 * arb.pi() * p["resistance"] * c)
    v = min(p["minimum_capacitance"], p["maximum_capacitance"]) / c
    return {"capacitance": c, "frequency": f, "voltage": v, "current": p["transconductance"] * v}


def chain_current(p: Numbers) -> Found:
    return {"value": capacitive_chain({**p, "resistance": arb(1)})["current"]}


def alternating_capacitance_paper(p: Numbers) -> Found:
    low, high = p["minimum_capacitance"], p["maximum_capacitance"]
    return {"value": low + (high - low) * sine(p)}


def alternating_current(p: Numbers, *, raised_swing: bool, moving: bool) -> Found:
    low, high = p["minimum_capacitance"], p["maximum_capacitance"]
    w, wc = 2 * arb.pi() * p["voltage_frequency"], 2 * arb.pi() * p["frequency"]
    s, turn = sine(p), wc * cosine(p)
    if raised_swing:
        s, turn = (1 + s) / 2, turn / 2
    current = (low + (high - low) * s) * w * cosine(p, "voltage_frequency")
    if moving:
        current += (high - low) * turn * sine(p, "voltage_frequency")
    return {"value": p["voltage"] * current}


def proximity(p: Numbers) -> Found:
    d = p["mean_distance"] + p["distance_amplitude"] * sine(p)
    return proximity_at({**p, "distance": d})


def proximity_at(p: Numbers) -> Found:
    near = (-p["damping"] * p["distance"]).exp()
    inductance = p["base_inductance"] - p["inductance_change"] * near
    frequency = lc_frequency({"inductance": inductance, "capacitance": p["capacitance"]})["value"]
    return {"distance": p["distance"], "inductance": inductance, "frequency": frequency}


def resonance(p: Numbers) -> Found:
    inductance = raised(p, "minimum_inductance", "maximum_inductance")
    w = 2 * arb.pi() * p["source_frequency"]
    x = w * inductance - 1 / (w * p["capacitance"])
    z = (p["resistance"] ** 2 + x**2).sqrt()
    return {
        "inductance": inductance,
        "oscillation": 1 / (2 * arb.pi() * (inductance * p["capacitance"]).sqrt()),
        "reactance": x,
        "impedance": z,
        "current": p["voltage"] / z,
        "phase": -(x / p["resistance"]).atan(),
    }


def coil_energy(p: Numbers) -> Found:
    z, inductance = p["loss_resistance"], p["inductance"]
    start = inductance * (p["voltage"] / z) ** 2 / 2
    return {"value": start * (-2 * z * p["time"] / inductance).exp()}


def energy_flow(p: Numbers) -> Found:
    switch, coil, series = (
        p["switch_resistance"],
        p["coil_resistance"],
        p["capacitor_resistance"],
    )
    v, inductance, c, t = p["voltage"], p["inductance"], p["capacitance"], p["time"]
    r = switch + coil
    tau = inductance / r
    filled = -(-t / tau).expm1()
    into_coil = v**2 / r * (t - tau * filled)
    magnetic = inductance * (v / r * filled) ** 2 / 2
    heat = into_coil - magnetic
    full = -(-t / (series * c)).expm1()
    electric, into_capacitor = c * (v * full) ** 2 / 2, c * v**2 * full
    return {
        "supplied": into_coil + into_capacitor,
        "magnetic": magnetic,
        "electric": electric,
        "stored": magnetic + electric,
        "switch_loss": heat * switch / r,
        "coil_loss": heat * coil / r,
        "capacitor_loss": into_capacitor - electric,
        "loss": heat + into_capacitor - electric,
    }
