"""``python -m tests.architecture.prose``: refuse words that plain technical English does not need.

Counts of a file may shrink and not grow. ``--update`` writes the present counts to the baseline,
for instance after a file was renamed, unless there are more occurrences than before in all.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
BASELINE: Final = Path(__file__).with_suffix(".json")
_BANNED: Final = (
    "whoever|somebody|nobody|anybody|strangers?|tells|told|heed(?:s|ed|ing)?|bury|buri(?:es|ed)|burying"
    "|begrudg(?:e|es|ed|ing)|hearken(?:s|ed|ing)?|as it were"
    "|whom|wish(?:es|ed)?|for ever(?!y)|poor(?:er)?"
)
# An underscore separates words, too: names of tests and functions are prose.
_WORD: Final = re.compile(rf"(?<![a-z])(?:{_BANNED})(?![a-z])", re.IGNORECASE)


def find(text: str) -> list[tuple[int, str]]:
    """Line and word of each banned word."""
    lines = enumerate(text.splitlines(), start=1)
    return [(number, each[0]) for number, line in lines for each in _WORD.finditer(line)]


def _tracked() -> dict[str, list[tuple[int, str]]]:
    listed = subprocess.run(
        ["git", "ls-files", "*.py", "*.ts", "*.md"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    own = {f"tests/architecture/{name}.py" for name in ("prose", "test_prose")}
    # A file that was deleted and not yet committed is listed still.
    texts = {name: ROOT / name for name in listed if name not in own and (ROOT / name).exists()}
    found = {name: find(path.read_text()) for name, path in texts.items()}
    return {name: words for name, words in sorted(found.items()) if words}


def main() -> None:
    """Print each occurrence in a file that has more of them than its baseline; exit status 1."""
    found = _tracked()
    allowed: dict[str, int] = json.loads(BASELINE.read_text())
    total, before = sum(map(len, found.values())), sum(allowed.values())
    if "--update" in sys.argv[1:]:
        if total > before:
            sys.exit(f"not updated: {total} banned words, {before} in the baseline")
        counts = {name: len(words) for name, words in found.items()}
        BASELINE.write_text(json.dumps(counts, indent=1) + "\n")
        return
    grown = {name: words for name, words in found.items() if len(words) > allowed.get(name, 0)}
    for name, words in grown.items():
        print(f"{name}: {len(words)} banned words, {allowed.get(name, 0)} in the baseline")
        for line, word in words:
            print(f"  {name}:{line}: {word}")
    if grown:
        sys.exit(1)


if __name__ == "__main__":
    main()
