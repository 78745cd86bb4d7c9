from __future__ import annotations

import ast
from pathlib import Path

import eskin_sensor_node
from eskin_sensor_node.kinds import registry

ROOM = Path(eskin_sensor_node.__file__).parent
KINDS = {kind.settings.__module__.rpartition(".")[2] for kind in registry.KINDS.values()}


def imported_names(path: Path) -> set[str]:
    """What a file imports when it runs, as ``module.name``."""
    found: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return found


def test_firmware_imports_what_every_port_has_and_computes_alike() -> None:
    files = sorted((ROOM / "firmware").rglob("*.py"))
    assert len(files) >= 10
    exact = {"math.ceil", "math.floor", "math.frexp", "math.ldexp", "math.sqrt"}
    for file in files:
        for name in imported_names(file):
            own = name.startswith("eskin_sensor_node.firmware.")
            assert own or name in exact | {"array.array", "struct"}, (file.name, name)


def test_only_what_senses_knows_the_world() -> None:
    knowing = {
        str(file.relative_to(ROOM))
        for room in ("node", "skin_node", "fleet", "columns")
        for file in (ROOM / room).glob("*.py")
        if any("eskin_sensor_node.kinds.registry.build_" in name for name in imported_names(file))
    }
    assert knowing == {"columns/sensing.py"}


def kinds_named(file: Path) -> set[str]:
    """Kinds of which a file imports something."""
    rooms = [name.split(".") for name in imported_names(file)]
    return {room[2] for room in rooms if room[:2] == ["eskin_sensor_node", "kinds"]} & KINDS


def test_no_kind_knows_another_one() -> None:
    assert len(KINDS) >= 9
    for kind in sorted(KINDS):
        assert kinds_named(ROOM / "kinds" / f"{kind}.py") == set(), kind


def test_only_registry_and_datasets_name_kinds() -> None:
    naming = {
        str(file.relative_to(ROOM).parent) for file in ROOM.rglob("*.py") if kinds_named(file)
    }
    assert naming == {"kinds", "tools/dataset"}
