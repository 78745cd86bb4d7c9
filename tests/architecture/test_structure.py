"""Imports go one way, and public names exist and are documented."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import tomllib
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ["eskin", "eskin_sensor_node", "eskin_gateway", "eskin_cloud", "eskin_ca"]
FOLDERS = ["eskin", "sensor_node", "gateway", "cloud", "ca_service"]
SOURCES = [
    path
    for room in [*FOLDERS, "tests", "benchmarks"]
    for path in sorted((ROOT / room).rglob("*.py"))
    if "node_modules" not in path.parts
]
FORBIDDEN = {"utils", "helpers", "common", "misc", "util", "helper"}


def test_no_room_or_file_is_named_helpers() -> None:
    names = {path: {path.stem, path.parent.name} for path in SOURCES}
    assert [path for path, found in names.items() if found & FORBIDDEN] == []


def packages() -> list[str]:
    found = []
    for room in PACKAGES:
        module = importlib.import_module(room)
        found.append(room)
        found += [
            info.name for info in pkgutil.walk_packages(module.__path__, f"{room}.") if info.ispkg
        ]
    return found


@pytest.mark.parametrize("name", packages())
def test_public_names_of_a_package_exist_and_are_documented(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__doc__, f"{name} has no docstring"
    public = getattr(module, "__all__", [])
    assert list(public) == sorted(set(public))
    imported = {
        alias.asname or alias.name
        for node in ast.parse(Path(module.__file__ or "").read_text()).body
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES
        for alias in node.names
    }
    if public:
        assert imported - set(public) - {"main", "annotations"} <= _used_inside(module)
    documented = _documented_constants()
    for item in public:
        value = getattr(module, item)
        # A constant inherits the docstring of its type, which does not describe it.
        own = value.__doc__ if value.__doc__ != type(value).__doc__ else None
        assert own or item in documented, f"{name}.{item} has no docstring"


@cache
def _documented_constants() -> frozenset[str]:
    """Names whose assignment is followed by a docstring."""
    return frozenset(
        getattr(target, "id", "")
        for path in SOURCES
        for one, other in pairwise(ast.parse(path.read_text()).body)
        if isinstance(one, ast.Assign | ast.AnnAssign)
        and isinstance(other, ast.Expr)
        and isinstance(other.value, ast.Constant)
        for target in (one.targets if isinstance(one, ast.Assign) else [one.target])
    )


def _used_inside(module: object) -> set[str]:
    """Names that an ``__init__`` imports for its own use."""
    tree = ast.parse(Path(getattr(module, "__file__", "")).read_text())
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def test_imports_go_one_way() -> None:
    done = subprocess.run(
        [ROOT / ".venv" / "bin" / "lint-imports", "--no-cache"],
        capture_output=True, text=True, cwd=ROOT, timeout=250, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_import_rule_of_the_library_lists_each_of_its_packages() -> None:
    """A module that is missing in the list could import a tier."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (law,) = [each for each in rules["contracts"] if each["name"].startswith("No part of eskin")]
    modules = {f"eskin.{module.name}" for module in pkgutil.iter_modules([str(ROOT / "eskin")])}
    assert set(law["source_modules"]) == modules - {"eskin.cli", "eskin.demo", "eskin.__main__"}


def test_import_of_eskin_loads_no_tier_and_no_server() -> None:
    code = (
        "import eskin, sys; print(sorted({m.split('.')[0] for m in sys.modules}));"
        "assert 'eskin.models' not in sys.modules; assert eskin.models.icm; assert eskin.noise"
    )
    done = subprocess.run(
        [ROOT / ".venv" / "bin" / "python", "-c", code],
        capture_output=True, text=True, timeout=250, check=True,
    )  # fmt: skip
    loaded = set(ast.literal_eval(done.stdout))
    assert not loaded & {*PACKAGES[1:], "fastapi", "sqlalchemy", "paho"}
    # Slow imports are deferred to their first use.
    assert not loaded & {"cryptography", "rich", "matplotlib", "pandas", "xarray"}
