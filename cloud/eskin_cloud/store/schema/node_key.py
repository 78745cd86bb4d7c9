"""What each key of a node's rows begins with: the node's slot, and its name.

Each query of nodes names their slots, too: the keys begin with them, and they share the rows out to
machines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import Column, Integer, and_, tuple_

from eskin.wire.slot import key_of, slot_of
from eskin_cloud.store.text_type import Text

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import ColumnElement, FromClause
    from sqlalchemy.engine.default import DefaultExecutionContext

NODE_LENGTH: Final = 63


def node_key() -> tuple[Column[int], Column[str]]:
    """The two columns; an insert derives the slot from the name."""
    return (
        Column("slot", Integer, primary_key=True, autoincrement=False, default=_slot),
        Column("node", Text(NODE_LENGTH), primary_key=True),
    )


def _slot(context: DefaultExecutionContext) -> int:
    row: dict[str, Any] = context.get_current_parameters()  # type: ignore[no-untyped-call]  # untyped in SQLAlchemy
    return slot_of(row["node"])


def of_node(table: FromClause, node: str) -> ColumnElement[bool]:
    """Whether a row is of a node."""
    return and_(table.c.slot == slot_of(node), table.c.node == node)


def of_nodes(table: FromClause, nodes: Collection[str]) -> ColumnElement[bool]:
    """Whether a row is of one of some nodes."""
    slots = {slot_of(node) for node in nodes}
    return and_(table.c.slot.in_(sorted(slots)), table.c.node.in_(sorted(nodes)))


def of_boots(table: FromClause, boots: Iterable[tuple[str, int]]) -> ColumnElement[bool]:
    """Whether a row is of one of some boots: pairs of a node and its boot."""
    key = tuple_(table.c.slot, table.c.node, table.c.boot)
    return key.in_([(*key_of(node), boot) for node, boot in boots])


def of_same_node(table: FromClause, other: FromClause) -> ColumnElement[bool]:
    """Whether the rows of two tables are of one node."""
    return and_(table.c.slot == other.c.slot, table.c.node == other.c.node)
