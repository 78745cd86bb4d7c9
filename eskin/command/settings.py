"""All settings as a page: ``python -m eskin.command.settings > docs/settings.md``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from authority.settings import AuthoritySettings
from cloud.settings import CloudSettings
from eskin.settings import table
from gateway.settings import GatewaySettings
from sensor_node.settings import NodeSettings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.settings import Settings

PROCESSES: dict[str, type[Settings]] = {
    "eskin node": NodeSettings,
    "eskin gateway": GatewaySettings,
    "eskin cloud": CloudSettings,
    "eskin pki serve": AuthoritySettings,
}

_HEAD = """\
# Settings

Each process reads one TOML file (`--config FILE.toml`, or `ESKIN_CONFIG`). A setting `section.name`
stands in the table `[section]`, or in the environment as `ESKIN_SECTION_NAME`, which wins. An
unknown setting, a wrong type or a value out of range ends the process with status 2 and one line
that names it.
"""


def page() -> str:
    """The whole page as Markdown."""
    return "\n".join([_HEAD, *_tables()])


def _tables() -> Iterator[str]:
    for process, settings in PROCESSES.items():
        yield f"## `{process}`\n\n| setting | default | what it is |\n|---|---|---|"
        for row in table(settings):
            default = "*must be given*" if row.default is None else f"`{row.default}`"
            yield f"| `{row.name}` | {default} | {row.help} |"
        yield ""


if __name__ == "__main__":
    sys.stdout.write(page())
