"""What both listeners share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from cloud.commands import Board
    from cloud.ingest.gatekeeper import Gatekeeper
    from cloud.ingest.uploads import Uploads
    from cloud.live import Feed, Onlookers
    from cloud.metrics import Metrics
    from cloud.privacy.keyholder import Keyholder
    from cloud.settings import CloudSettings
    from cloud.store import Store
    from eskin.limiting import RateLimit


@dataclass(frozen=True, slots=True)
class Cloud:
    """The state of one cloud process.

    Attributes:
        settings: All settings.
        store: Keeps everything.
        feed: Tells what is stored as it comes.
        onlookers: Knows which nodes somebody looks at.
        board: Wakes gateways that wait for commands.
        gatekeeper: Verifies certificates of gateways, and those of nodes that they present.
        uploads: Room for what gateways bring.
        metrics: Counts.
        sign_ins: Counts refused sign-ins that the audit log keeps.
        keyholder: Opens what tells of a person, for those who may.
        clock: Gives UTC ns.
        dashboard: Folder of the built dashboard.
    """

    settings: CloudSettings
    store: Store
    feed: Feed
    onlookers: Onlookers
    board: Board
    gatekeeper: Gatekeeper
    uploads: Uploads
    metrics: Metrics
    sign_ins: RateLimit
    keyholder: Keyholder
    clock: Callable[[], int]
    dashboard: Path

    @property
    def secure(self) -> bool:
        """Whether people come by HTTPS."""
        return self.settings.people.identity is not None
