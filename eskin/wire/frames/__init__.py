"""Frames of a skin, their descriptions, and statements (``docs/messages.md``)."""

from __future__ import annotations

from eskin.wire.frames.content_hash import content_hash
from eskin.wire.frames.described_layout import DescribedLayout
from eskin.wire.frames.encoded_frame import EncodedFrame
from eskin.wire.frames.frame import Frame, Grid, PatchSamples, frame_limit
from eskin.wire.frames.layout import ClosedLine, Controller, Layout, Seam
from eskin.wire.frames.patch import Patch, Privacy
from eskin.wire.frames.sample_codec import (
    SampleCodes,
    Sampling,
    decode_samples,
    encode_matrices,
    encode_samples,
)
from eskin.wire.frames.statements import (
    Because,
    Contact,
    Gap,
    Link,
    MonitorVerdict,
    Peak,
    Statements,
)

__all__ = [
    "Because",
    "ClosedLine",
    "Contact",
    "Controller",
    "DescribedLayout",
    "EncodedFrame",
    "Frame",
    "Gap",
    "Grid",
    "Layout",
    "Link",
    "MonitorVerdict",
    "Patch",
    "PatchSamples",
    "Peak",
    "Privacy",
    "SampleCodes",
    "Sampling",
    "Seam",
    "Statements",
    "content_hash",
    "decode_samples",
    "encode_matrices",
    "encode_samples",
    "frame_limit",
]
