"""Answers to gateways."""

from typing import Annotated, Literal, NotRequired

from pydantic import BaseModel, Field
from typing_extensions import TypedDict


class ResultDocument(TypedDict):
    """What became of one message."""

    result: Annotated[
        Literal["stored", "duplicate", "rejected", "unknown_node", "unknown_layout", "later"],
        Field(description="later: the message is not stored now, while others are; send it again"),
    ]
    reason: str | None
    want: NotRequired[
        Annotated[
            list[str],
            Field(description="of an unknown layout: SHA-256 of descriptions to present, hex"),
        ]
    ]


class IngestDocument(TypedDict):
    """What became of a batch, in its order."""

    items: list[ResultDocument]


class DescriptionItem(BaseModel):
    """What became of one description."""

    result: Literal["stored", "duplicate", "rejected", "unknown_node"]
    reason: str | None


class DescriptionsDocument(BaseModel):
    """What became of each description, in the order in which they were presented."""

    items: list[DescriptionItem]


class ConfirmedItem(BaseModel):
    """Numbers of a boot that are not stored here; the last one included."""

    node: str
    boot: int
    first: int
    last: int


class ConfirmedDocument(BaseModel):
    """Confirmed messages that are missing; nodes whose certificates are needed first."""

    items: list[ConfirmedItem]
    unknown_nodes: list[str]


class NoticeItem(BaseModel):
    """What became of a subject's key here."""

    id: str
    result: Literal["kept", "declined", "erased", "conflict", "unknown_node"]


class NoticeDocument(BaseModel):
    """The answer to a notice of subjects."""

    items: list[NoticeItem]
