"""A command, cloud to node; it travels signed by the cloud (COSE_Sign1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import CommandError, IdentityError, MessageError
from eskin.wire.messages.cbor_map import MOST_COUNT, dump, load, read_texts, sort_texts
from eskin.wire.messages.command_schema import CommandName, check_arguments
from eskin.wire.messages.header import Kind
from eskin.wire.timestamp import MOST_MOMENT

if TYPE_CHECKING:
    from eskin.wire.messages.command_schema import Arguments

_FIELDS: Final = frozenset(range(1, 8))
_MOST_ARGUMENTS: Final = 16


@dataclass(frozen=True, slots=True)
class Command:
    """What a node is asked to do, once.

    Attributes:
        id: Greater than those of all commands before to the same node; from 1 on.
        node: Who is asked.
        issued: When, by the cloud's clock, UTC ns.
        expires: From when on it must not be done any more, UTC ns.
        name: What to do.
        arguments: As `check_arguments` allows.
    """

    id: int
    node: str
    issued: int
    expires: int
    name: CommandName
    arguments: Arguments

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump(
            {1: int(Kind.COMMAND), 2: self.id, 3: self.node, 4: self.issued, 5: self.expires}
            | {6: str(self.name), 7: sort_texts(self.arguments)}
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a command.

        Raises:
            MessageError: It is none.
        """
        # Cryptography comes with identities: not for who reads no command.
        from eskin.identity.identity_kind import IdentityKind  # noqa: PLC0415

        fields = load(data)
        fields.only(_FIELDS)
        kind = fields.integer(1, 0, 255)
        if kind != Kind.COMMAND:
            raise MessageError(f"field 1 is {kind}; expected a command ({Kind.COMMAND:d})")
        try:
            node = IdentityKind.NODE.require_name(fields.text(3, 63))
            name = _name(fields.text(6, 16))
            arguments = read_texts(fields.raw(7), "field 7", _MOST_ARGUMENTS)
            return cls(
                id=fields.integer(2, 1, MOST_COUNT),
                node=node,
                issued=fields.integer(4, -MOST_MOMENT, MOST_MOMENT),
                expires=fields.integer(5, -MOST_MOMENT, MOST_MOMENT),
                name=name,
                arguments=check_arguments(name, arguments),
            )
        except (CommandError, IdentityError) as error:
            raise MessageError(str(error)) from error


def _name(text: str) -> CommandName:
    if text not in CommandName.__members__.values():
        raise MessageError(f"field 6 is {text!r}; allowed: {', '.join(CommandName)}")
    return CommandName(text)
