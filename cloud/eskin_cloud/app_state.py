"""What both listeners share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.runtime.http_server.rate_limit import RateLimit
    from eskin_cloud.alarms.evaluator import Evaluator
    from eskin_cloud.commands.command_queue import Notifier
    from eskin_cloud.ingest.gateway_contacts import GatewayContacts
    from eskin_cloud.ingest.gateway_trust import GatewayTrust
    from eskin_cloud.ingest.upload_budget import UploadBudget
    from eskin_cloud.live import Feed, LiveContacts
    from eskin_cloud.metrics import Metrics
    from eskin_cloud.privacy.key_access import KeyAccess
    from eskin_cloud.settings import CloudSettings
    from eskin_cloud.store import Store


@dataclass(frozen=True, slots=True)
class AppState:
    """The state of one cloud process.

    Attributes:
        settings: All settings.
        store: Keeps everything.
        feed: The live feed of what is stored.
        contacts: Contacts of the nodes that streams of frames have chosen.
        notifier: Wakes gateways that wait for commands.
        gateway_trust: Verifies certificates of gateways, and those of nodes that they present.
        gateway_contacts: Writes when gateways brought something.
        uploads: Room for what gateways bring.
        metrics: Counts.
        sign_ins: Counts refused sign-ins that the audit log keeps.
        evaluator: Evaluates monitors over what arrives.
        key_access: Decrypts biometric messages for permitted callers.
        clock: Gives UTC ns.
        dashboard: Folder of the built dashboard.
    """

    settings: CloudSettings
    store: Store
    feed: Feed
    contacts: LiveContacts
    notifier: Notifier
    gateway_trust: GatewayTrust
    gateway_contacts: GatewayContacts
    uploads: UploadBudget
    metrics: Metrics
    sign_ins: RateLimit
    evaluator: Evaluator
    key_access: KeyAccess
    clock: Callable[[], int]
    dashboard: Path

    @property
    def secure(self) -> bool:
        """Whether people come by HTTPS."""
        return self.settings.people.identity is not None
