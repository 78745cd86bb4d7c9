from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import mpmath
import pytest
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.settings import NodeSettings

from eskin.errors import SettingsError
from tests.unit.sensor_node.designs import settings, table, taxel

if TYPE_CHECKING:
    from pathlib import Path

HEAD = """
[node]
name = "n1"
profile = "{profile}"
[identity]
directory = "identity"
site = "site.pem"
[flash]
path = "flash.sqlite"
[truth]
path = "truth.sqlite"
"""


def written(folder: Path, text: str, profile: str = "fingertip") -> Path:
    path = folder / "node.toml"
    path.write_text(HEAD.format(profile=profile) + text)
    return path


PROFILES = ["fingertip", "forearm", "hand", "palm", "paper-hand", "small-hand", "sock", "sole"]
SKINS = {"paper-hand": 8400, "small-hand": 336}


def test_packaged_profiles_are_the_eight() -> None:
    assert profile_names() == PROFILES


@pytest.mark.parametrize("name", SKINS)
def test_a_profile_with_a_skin_has_no_other_taxels(name: str, tmp_path: Path) -> None:
    loaded = settings(tmp_path, name)
    assert (len(loaded.taxel), loaded.skin.taxels) == (0, SKINS[name])
    faster = NodeSettings.load(written(tmp_path, "[skin]\nsampling_hz = 100.0\n", name))
    rows = round(loaded.skin.stretch_ms / 10.0)
    assert (faster.skin.rows, faster.skin.scenario) == (rows, loaded.skin.scenario)
    # Own taxels win over a profile's skin, and an own skin over its taxels.
    own = NodeSettings.load(written(tmp_path, Profile.read("palm").text, name))
    assert (own.skin.present, len(own.taxel)) == (False, 1)
    other = NodeSettings.load(written(tmp_path, Profile.read(name).text, "palm"))
    assert (other.skin.taxels, len(other.taxel)) == (SKINS[name], 0)


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_s_name_and_its_copied_text_give_the_same_taxels(
    name: str, tmp_path: Path
) -> None:
    short = NodeSettings.load(written(tmp_path, "", name))
    copied = NodeSettings.load(written(tmp_path, Profile.read(name).text, name))
    assert short == copied
    assert short.node.description.startswith(name)


def test_a_profile_s_energy_is_read_and_a_file_s_own_keys_win(tmp_path: Path) -> None:
    of_profile = NodeSettings.load(written(tmp_path, "", "sole"))
    assert of_profile.energy.on
    assert (of_profile.energy.piezo_gain, of_profile.sampling.stretch_ms) == (735.0, 2000.0)
    own = NodeSettings.load(written(tmp_path, "[energy]\npiezo_gain = 7.0\n", "sole"))
    assert (own.energy.on, own.energy.piezo_gain) == (True, 7.0)
    with pytest.raises(SettingsError, match="energy"):
        NodeSettings.load(written(tmp_path, "energy = 3\n", "sole"))


def test_a_file_s_own_taxels_win_over_the_profile_s(tmp_path: Path) -> None:
    text = Profile.read("palm").text
    loaded = NodeSettings.load(written(tmp_path, text, "fingertip"))
    assert [t.kind for t in loaded.taxel] == ["touch"]


def test_channels_of_the_profiles_are_those_of_the_contract(tmp_path: Path) -> None:
    found = {
        name: [
            f"{t.id}.{q}:{u}" for t in settings(tmp_path, name).taxel for q, u in t.units.items()
        ]
        for name in profile_names()
        if name not in SKINS
    }
    pad = ("capacitance:F", "current:A", "plate_distance:m", "contact_area:m2", "pressure:Pa")
    assert found.pop("sock") == found["sole"]
    assert found == {
        "sole": [f"t0{n}.{quantity}" for n in (1, 2, 3) for quantity in pad],
        "fingertip": [
            f"t0{n}.{quantity}" for n in (1, 2, 3) for quantity in ("capacitance:F", "current:A")
        ],
        "palm": ["t01.area:m2", "t01.capacitance:F", "t01.energy:J"],
        "forearm": [
            "t01.frequency:Hz",
            "t01.inductance:H",
            "t01.distance:m",
            "t02.current:A",
            "t02.voltage:V",
        ],
        "hand": [
            *(f"t{n:02d}.{quantity}" for n in (*range(12), 13, 15) for quantity in pad),
            *(
                f"m{n}.{quantity}"
                for n in ("06", "10")
                for quantity in (
                    *("frequency:Hz", "inductance:H", "distance:m"),
                    *("eddy_amplitude:1", "eddy_phase:rad"),
                )
            ),
            *("a01.temperature:Cel", "a02.humidity:%", "b01.bioelectric:V"),
        ],
    }


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    ("capacitive", {"capacitance_min_F": 2e-10}, "capacitance_max_F"),
    ("capacitive", {"capacitance_min_F": -1e-12}, "capacitance_min_F"),
    ("capacitive", {"resistance_ohm": 0.0}, "resistance_ohm"),
    ("capacitive", {"adc_min_A": 2e-3}, "adc_max_A"),
    ("capacitive", {"typo_F": 1.0}, "typo_F"),
    ("capacitive", {"stimulus_Hz": "2"}, "stimulus_Hz"),
    ("capacitive", {"sampling_Hz": 3e5}, "sampling_Hz"),
    ("capacitive", {"capacitance_min_F": math.nan}, "capacitance_min_F"),
    ("touch", {"area_min_m2": 1e-3}, "area_max_m2"),
    ("touch", {"relative_permittivity": 0.5}, "relative_permittivity"),
    ("touch", {"noise": {"kind": "gaussian", "sigma": -1.0}}, "sigma"),
    ("inductive", {"inductance_change_H": 9.9e-3}, "inductance_change_H"),
    ("inductive", {"distance_amplitude_m": 0.03}, "distance_mid_m"),
    ("hybrid", {"burst_s": 2.0}, "burst_period_s"),
    ("hybrid", {"kind": "hybird"}, "taxel.0"),
    ("hybrid", {"id": "T 1"}, "id"),
]


@pytest.mark.parametrize(("kind", "changes", "setting"), REFUSED)
def test_impossible_taxel_is_refused_by_the_setting_s_name(
    kind: str, changes: dict[str, Any], setting: str, tmp_path: Path
) -> None:
    lines = [f"{key} = {toml(value)}" for key, value in table(kind, **changes).items()]
    path = written(tmp_path, "\n".join(["[[taxel]]", *lines]))
    with pytest.raises(SettingsError) as refusal:
        NodeSettings.load(path)
    assert refusal.value.setting.startswith("taxel.0")
    assert refusal.value.setting.endswith(setting)


def test_twice_the_same_taxel_is_refused(tmp_path: Path) -> None:
    text = Profile.read("palm").text
    text = text[text.index("[[taxel]]") :]
    with pytest.raises(SettingsError, match="the same id twice: t01"):
        NodeSettings.load(written(tmp_path, text + text))


def test_unknown_profile_without_taxels_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="taxel"):
        NodeSettings.load(written(tmp_path, "", "elbow"))


def test_environment_wins_over_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ESKIN_BROKER_PORT", "1234")
    monkeypatch.setenv("ESKIN_NODE_PROFILE", "palm")
    loaded = NodeSettings.load(written(tmp_path, ""))
    assert loaded.broker.port == 1234
    assert loaded.taxel[0].kind == "touch"


@pytest.mark.parametrize("k", [1.0, 3.0, 6.0, 8.0])
def test_gaussian_coverage_is_rounded_down(k: float) -> None:
    noise = taxel("touch", noise={"kind": "gaussian", "sigma": 1e-7, "k": k}).noise
    with mpmath.workprec(200):
        exact = 1 - mpmath.erfc(mpmath.mpf(k) / mpmath.sqrt(2))
        assert mpmath.mpf(noise.coverage) <= exact
        assert exact - mpmath.mpf(noise.coverage) < 1e-11


def toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + "}"
    return f'"{value}"' if isinstance(value, str) else repr(value)
