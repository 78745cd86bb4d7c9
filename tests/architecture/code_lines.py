"""``python -m tests.architecture.code_lines``: lines of product code in Python, a package a row.

A line counts if it holds a token of code. Docstrings, comments, blank lines and imports do not
count. The packages of the tiers count, and ``eskin``; tests, benchmarks and scripts do not.
"""

from __future__ import annotations

import argparse
import ast
import io
import subprocess
import tokenize
from collections import Counter
from pathlib import Path
from typing import Final

NOT_PRODUCT: Final = ("tests/", "benchmarks/", "docs/", "services/", "setup.py")
_NO_CODE: Final = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def count(source: str) -> int:
    """Lines of code in a module's source."""
    left_out: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        plain = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if plain or isinstance(node, ast.Import | ast.ImportFrom):
            assert isinstance(node, ast.stmt)
            left_out |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - left_out)


def main() -> None:
    """Print the lines of each package, and their sum."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.architecture.code_lines", description=__doc__
    )
    parser.add_argument("folder", nargs="?", type=Path, default=Path(), help="of a git checkout")
    folder: Path = parser.parse_args().folder
    listed = subprocess.run(
        ["git", "ls-files", "*.py"], cwd=folder, capture_output=True, text=True, check=True
    ).stdout.split()
    product = [name for name in listed if not name.startswith(NOT_PRODUCT)]
    found = Counter[str]()
    for name in product:
        found[name.partition("/")[0]] += count((folder / name).read_text())
    for package, lines in sorted(found.items()):
        print(f"{package:12} {lines:6}")
    print(f"{'all':12} {found.total():6} in {len(product)} files")


if __name__ == "__main__":
    main()
