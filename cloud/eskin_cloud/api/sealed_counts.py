"""What a reader may count: of what is sealed, only those with the scope."""

from collections.abc import Sequence

from sqlalchemy import Connection

from eskin_cloud.access import Scope
from eskin_cloud.api.dependencies import Access
from eskin_cloud.query.listing import sealed_nodes


def uncounted(
    connection: Connection, access: Access, names: Sequence[str] | None = None
) -> set[str]:
    """Those of these nodes, or of all, whose messages the caller must not be able to count.

    They have a biometric channel, and the caller lacks its scope: a peak is a heartbeat.
    """
    if Scope.BIOMETRIC in access.holder.scopes:
        return set()
    return sealed_nodes(connection, names)
