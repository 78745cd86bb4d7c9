"""Apply erasures that another cloud on the same store received."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_cloud.jobs.periodic import run_periodically

if TYPE_CHECKING:
    from eskin_cloud.app_state import AppState

_INTERVAL_S: Final = 1.0


async def apply_erasures(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look each second, so that keys are destroyed also where no request reads."""
    if cloud.key_access.keystore is not None:
        work = partial(asyncio.to_thread, _apply, cloud)
        await run_periodically(
            "erasures", work, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S
        )


def _apply(cloud: AppState) -> None:
    with cloud.store.read() as connection:
        cloud.key_access.apply_erasures(connection)
