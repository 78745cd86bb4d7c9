"""Fields of a message: a key and what it holds (RFC 8949)."""

from eskin_sensor_node.firmware.cbor import Writer

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def put_integer(out: Writer, key: int, value: int) -> None:
    """A number."""
    out.integer(key)
    out.integer(value)


def put_integers(out: Writer, key: int, values: "Sequence[int]") -> None:
    """An array of numbers."""
    out.integer(key)
    out.array(len(values))
    for value in values:
        out.integer(value)


def put_real(out: Writer, key: int, value: float) -> None:
    """A float."""
    out.integer(key)
    out.real(value)


def put_reals(out: Writer, key: int, values: "Sequence[float]") -> None:
    """An array of floats."""
    out.integer(key)
    out.array(len(values))
    for value in values:
        out.real(value)


def put_text(out: Writer, key: int, value: str) -> None:
    """A text."""
    out.integer(key)
    out.text(value)
