"""Finding the program of an installed Mosquitto."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Final

_FOLDERS: Final = ("/usr/local/sbin", "/usr/sbin")
"""Where packages put it; not every user's PATH has them."""
_PATIENCE_S: Final = 10.0


def find_mosquitto() -> Path | None:
    """The program of Mosquitto 2, which our configuration is for; ``None`` where there is none."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *_FOLDERS])
    found = shutil.which("mosquitto", path=path)
    if found is None:
        return None
    try:
        # Its help begins with its version, and its exit status is not 0.
        done = subprocess.run(  # noqa: S603 - of the user's own PATH
            [found, "-h"], capture_output=True, timeout=_PATIENCE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return Path(found) if done.stdout.startswith(b"mosquitto version 2.") else None
