from __future__ import annotations

import ast
from pathlib import Path

import sensor_node

ROOM = Path(sensor_node.__file__).parent


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return found


def test_firmware_sees_neither_the_world_nor_the_true_parts() -> None:
    files = sorted((ROOM / "firmware").glob("*.py"))
    assert len(files) >= 3
    for file in files:
        for module in imports(file):
            hidden = ("sensor_node.physics", "sensor_node.frontend", "sensor_node.truth")
            assert not module.startswith(hidden), (file.name, module)


def test_only_the_emulation_joins_world_and_firmware() -> None:
    joined = {
        file.name
        for file in ROOM.glob("*.py")
        if any(name.startswith("sensor_node.physics") for name in imports(file))
    }
    assert joined == {"emulation.py"}
