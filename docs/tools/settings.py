"""All settings as a page: ``python -m docs.tools.settings > docs/settings.md``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, get_args

from eskin_ca.settings import CaSettings, Expected
from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.kinds.settings import TaxelSection
from eskin_sensor_node.profile import profile_names
from eskin_sensor_node.settings import NodeSettings

from docs.tools.keys_table import keys_table
from eskin.runtime.settings import table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pydantic import BaseModel

    from eskin.runtime.settings import Setting, Settings

PROCESSES: dict[str, type[Settings]] = {
    "eskin node": NodeSettings,
    "eskin gateway": GatewaySettings,
    "eskin cloud": CloudSettings,
    "eskin pki serve": CaSettings,
}

_ELSEWHERE = {"taxel": "*the profile's*"}
"""What is given elsewhere where it is not set."""

_HEAD = """\
# Settings

Each process reads one TOML file (`--config FILE.toml`, or `ESKIN_CONFIG`). A setting `section.name`
stands in the table `[section]`, or in the environment as `ESKIN_SECTION_NAME`, which wins. An
unknown setting, a wrong type or a value out of range ends the process with status 2 and one line
that names it.

A table in double brackets, such as `[[taxel]]`, may stand more than once, and in the file only.

## The demo's files

`eskin demo` keeps these in its data folder (`eskin-data/`, or what `--data` names):

- `nodes/NAME/node.toml` is **yours to edit**. It is made at the node's first start, read at each
  start, and never overwritten. Delete it to have it made again. Its paths are absolute: if you
  move the data folder, change them, or delete the file.
- `gateway/gateway.toml`, `cloud/cloud.toml` and `access.json` are the demo's: written anew at each
  start, as ports change. What you change there is lost.

Relative paths in a file are relative to its folder: all of `eskin-data` can be moved while the demo
does not run.

To change gateway or cloud, or all processes at once, set variables before the start, as in
`ESKIN_LOG_LEVEL=DEBUG eskin demo`; each process has its log in `logs/`. For its nodes the demo sets
`ESKIN_BROKER_HOST` and `ESKIN_BROKER_PORT` itself, and with `--speed` also `ESKIN_NODE_SPEED`.
"""

_TAXELS = """\
### `[[taxel]]`

One table a sensing element, only in the file. Start from a packaged profile: {profiles}.

A profile with a `[skin]` has none. There, `[skin.pad]`, `[skin.thermometer]` and
`[skin.hygrometer]` take the keys of such a table, all but `id`, `kind`, `scenario`, `place`,
`sampling_Hz`, `thermometer` and `hygrometer`, which the skin sets.

A key ends in its SI unit. `X_tolerance` is relative: the true part lies anywhere inside
`X · [1 - tolerance, 1 + tolerance]`, and the firmware knows no more. `Q_prominence_UNIT` is the
least prominence of a peak of the quantity Q; without it, peaks of Q are not looked for. Each
quantity is a channel, `ID.QUANTITY`.
"""


def page() -> str:
    """The whole page as Markdown."""
    return "\n".join([_HEAD, *_tables()])


def _tables() -> Iterator[str]:
    for process, settings in PROCESSES.items():
        yield f"## `{process}`\n\n| setting | default | what it is |\n|---|---|---|"
        for row in table(settings):
            yield f"| `{row.name}` | {_shown(row)} | {row.help} |"
        yield ""
        if settings is NodeSettings:
            yield from _taxels()
        if settings is CaSettings:
            yield from keys_table("`[[identity]]`", Expected)


def _shown(row: Setting) -> str:
    """A default as people read it."""
    if row.name in _ELSEWHERE:
        return _ELSEWHERE[row.name]
    return {None: "*must be given*", "None": "*none*"}.get(row.default, f"`{row.default}`")


def _taxels() -> Iterator[str]:
    names = profile_names()
    links = ", ".join(
        f"[{name}](../sensor_node/eskin_sensor_node/profiles/{name}.toml)" for name in names
    )
    yield _TAXELS.format(profiles=links)
    for kind in KINDS.values():
        yield from keys_table(f"`[[taxel]]`, `kind = {_kind(kind.settings)}`", kind.settings)
    for model in get_args(TaxelSection.model_fields["noise"].annotation):
        yield from keys_table(f"`noise = {{ kind = {_kind(model)}, … }}` of a taxel", model)


def _kind(model: type[BaseModel]) -> str:
    return f'"{get_args(model.model_fields["kind"].annotation)[0]}"'


if __name__ == "__main__":
    sys.stdout.write(page())
