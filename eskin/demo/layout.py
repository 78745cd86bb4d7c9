"""Where things lie in the demo's data folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import IdentityKind


@dataclass(frozen=True, slots=True)
class DemoFolder:
    """The demo's data folder.

    Attributes:
        root: The folder itself.
    """

    root: Path

    @property
    def authority(self) -> Path:
        """Keys of the demo's CA."""
        return self.root / "ca"

    def revocations(self, kind: IdentityKind) -> Path:
        """A kind's revocation list; `eskin pki revoke` writes it anew."""
        return self.authority / f"{kind}.crl.pem"

    @property
    def broker(self) -> Path:
        """Mosquitto's configuration and what it keeps."""
        return self.root / "broker"

    @property
    def logs(self) -> Path:
        """One log file a process."""
        return self.root / "logs"

    @property
    def access(self) -> Path:
        """How scripts and other clients join in."""
        return self.root / "access.json"

    @property
    def owned(self) -> Path:
        """What a running demo owns (``demo.lock``)."""
        return self.root / "demo"

    @property
    def store(self) -> Path:
        """The cloud's database."""
        return self.root / "cloud" / "store.sqlite"

    @property
    def spool(self) -> Path:
        """The gateway's database."""
        return self.root / "gateway" / "spool.sqlite"

    @property
    def keys(self) -> Path:
        """The site's key store."""
        return self.root / "gateway" / "keys"

    @property
    def cloud_keys(self) -> Path:
        """The cloud's own copies of the keys."""
        return self.root / "cloud" / "keys"

    @property
    def nodes(self) -> Path:
        """One folder a node, or a fleet."""
        return self.root / "nodes"

    @property
    def truths(self) -> list[Path]:
        """What the emulators know: of each node, or of a whole fleet."""
        return sorted(self.nodes.glob("*/truth.sqlite"))

    @property
    def flashes(self) -> list[Path]:
        """The outboxes of each node, or of a whole fleet."""
        return sorted(self.nodes.glob("*/flash.sqlite"))

    def identity(self, name: str) -> Path:
        """Folder of an identity."""
        return self.root / "identities" / name

    def node(self, name: str) -> Path:
        """Folder of a node: ``node.toml``, its flash, and the truth that the emulator keeps."""
        return self.nodes / name

    def flash(self, name: str) -> Path:
        """A node's outbox."""
        return self.node(name) / "flash.sqlite"

    def node_settings(self, name: str) -> Path:
        """A node's settings; made at its first start, then the user's to change."""
        return self.node(name) / "node.toml"

    def truth(self, name: str) -> Path:
        """What the emulator knows and the node does not."""
        return self.node(name) / "truth.sqlite"

    def settings(self, process: str) -> Path:
        """Settings of the gateway or of the cloud; written anew at each start."""
        return self.root / process / f"{process}.toml"
