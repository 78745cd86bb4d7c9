# ruff: noqa: INP001 - a script, no part of a package
"""Print the part of requirements.lock that eskin needs, for ``pip install --require-hashes``.

Arguments name extras of pyproject.toml, whose libraries are added; ``--only`` leaves out all but
theirs. Without eskin's own code, so that an image reinstalls them only when the lock changes.
"""

import re
import sys
import tomllib
from pathlib import Path

NAME = re.compile(r"[A-Za-z0-9._-]+")


def plain(requirement: str) -> str:
    """The normalised name of a requirement."""
    found = NAME.match(requirement)
    assert found is not None, requirement  # noqa: S101 - our own files
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def wanted(extras: list[str], *, only: bool) -> set[str]:
    """What pyproject.toml itself names."""
    document = tomllib.loads(Path("pyproject.toml").read_text())
    project = document["project"]
    found = [] if only else document["build-system"]["requires"] + project["dependencies"]
    for extra in extras:  # grows under way
        for requirement in project["optional-dependencies"][extra]:
            if own := re.fullmatch(r"eskin\[(.*)\]", requirement):
                extras += own[1].split(",")
            else:
                found.append(requirement)
    return set(map(plain, found))


def main() -> None:
    """Print each entry of the lock that is wanted, or that one of those needs (its ``# via``)."""
    arguments = sys.argv[1:]
    names = wanted([a for a in arguments if a != "--only"], only="--only" in arguments)
    lock = Path("requirements.lock").read_text()
    entries = [(plain(text), text) for text in re.split(r"\n(?=[A-Za-z0-9])", lock.strip())]
    users = re.compile(r"# (?:via|  ) ?(\S+)$", re.MULTILINE)
    needed_by = [(name, set(users.findall(text))) for name, text in entries]
    before = 0
    while len(names) > before:
        before = len(names)
        names |= {name for name, needing in needed_by if needing & names}
    missing = names - {name for name, _ in entries}
    if missing:
        sys.exit(f"requirements.lock lacks {', '.join(sorted(missing))}; run services/lock.sh")
    for name, text in entries:
        if name in names:
            sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
