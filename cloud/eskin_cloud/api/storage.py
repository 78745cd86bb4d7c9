"""What the store takes of the disk."""

import math
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel

from eskin.errors import StoreError
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.schemas.base import NoQuery
from eskin_cloud.store.disk_usage import measure_disk

router = APIRouter(tags=["nodes"])


class StorageDocument(BaseModel):
    """What the store takes; what is free in it (if reported) is for what comes next.

    ``bytes_per_sample`` is all that is taken and not free, by the samples kept: frames, rows of
    patches, indices, tiles, events and all else. Without the scope `biometric`, where anything is
    sealed, both are rounded to 16 MiB.
    """

    bytes: int
    free_bytes: int
    samples: int
    bytes_per_sample: float | None


@router.get("/storage", responses=REFUSALS)
def get_storage(
    cloud: CloudState, access: Reader, query: Annotated[NoQuery, Query()]
) -> StorageDocument:
    """Read how much of the disk the store takes."""
    del query
    use = measure_disk(cloud.store)
    if math.isnan(use.taken):
        raise StoreError("the store cannot be read now; try again in an instant")
    with cloud.store.read() as connection:
        counted = not access.uncounted(connection)
    if not counted:
        use = use.coarse()
    return StorageDocument(
        bytes=int(use.taken),
        free_bytes=int(use.free),
        samples=int(use.samples),
        bytes_per_sample=use.each,
    )
