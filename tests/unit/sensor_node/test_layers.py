from __future__ import annotations

import ast
from pathlib import Path

import eskin_sensor_node

ROOM = Path(eskin_sensor_node.__file__).parent


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
        file.name
        for file in (ROOM / "node").glob("*.py")
        if any("eskin_sensor_node.kinds.registry.build_" in name for name in imported_names(file))
    }
    assert knowing == {"signal_chain.py"}
