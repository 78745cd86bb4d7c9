"""How the places of a node (its channels, its taxels, all of it) are set, as a result tells it."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eskin_sensor_node.firmware.cbor import Writer

    Places = Mapping[str, Mapping[str, float | str]]


def write_places(out: "Writer", places: "Places") -> None:
    """Write a map from places to maps of their settings, each a number or a text."""
    out.map(len(places))
    for place in _in_order(places):
        out.text(place)
        settings = places[place]
        out.map(len(settings))
        for name in _in_order(settings):
            out.text(name)
            value = settings[name]
            if isinstance(value, str):
                out.text(value)
            else:
                out.real(value)


def _in_order(texts: "Iterable[str]") -> "list[str]":
    """As their encodings follow each other (RFC 8949, section 4.2.1): short ones first."""
    encoded = [(len(each), each) for each in [text.encode() for text in texts]]
    return [each.decode() for _, each in sorted(encoded)]
