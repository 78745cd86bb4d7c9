"""Pictures of a skin as arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import pyarrow as pa

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from eskin.interval import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Pictures of a skin: hulls of its taxels over neighbouring stretches of time.

    Attributes:
        node: The node.
        layout: Hash of the layout by which they are read, see `Client.layout`.
        quantity: Such as ``pressure``.
        unit: UCUM code.
        taxels: Names, in the order of the columns.
        t: When each picture begins, UTC ns, shape ``(pictures,)``.
        dt: How long each lasts, ns.
        lo: Least lower bound of all samples of a taxel in ``[t, t + dt)``, shape ``(pictures,
            taxels)``; ``-inf`` where nothing is known.
        hi: Greatest upper bound; ``inf`` where nothing is known.
        contact: Whether a taxel was pressed at some time of the picture: 0 impossible, 1 possible
            (also where it is unknown at some time), 2 certain; ``None`` if the skin states no
            threshold.
        coverage: Probability that a hull encloses all its true values.
        time_error: Greatest distance of a sample's true time from its stated time, ns.
    """

    node: str
    layout: str
    quantity: str
    unit: str
    taxels: tuple[str, ...]
    t: NDArray[np.int64]
    dt: int
    lo: Floats
    hi: Floats
    contact: NDArray[np.uint8] | None
    coverage: float
    time_error: int

    def __len__(self) -> int:
        return self.t.size

    @classmethod
    def read(cls, content: bytes) -> Self:
        """Read an answer in Arrow's IPC stream."""
        with pa.ipc.open_stream(content) as reader:
            table = reader.read_all()
        metadata = {name.decode(): text.decode() for name, text in table.schema.metadata.items()}
        taxels = tuple(json.loads(metadata["taxels"]))
        shape = table.num_rows, len(taxels)

        def matrix(name: str) -> Any:
            return table[name].combine_chunks().flatten().to_numpy().reshape(shape)

        return cls(
            node=metadata["node"],
            layout=metadata["layout"],
            quantity=metadata["quantity"],
            unit=metadata["unit"],
            taxels=taxels,
            t=table["time"].cast(pa.int64()).to_numpy(),
            dt=int(metadata["dt"]),
            lo=matrix("lo"),
            hi=matrix("hi"),
            contact=matrix("contact") if "contact" in table.column_names else None,
            coverage=float(metadata["coverage"]),
            time_error=int(metadata["time_error"]),
        )
