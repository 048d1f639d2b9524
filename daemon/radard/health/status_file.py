"""The status file: how `radard health` knows, from outside and without HTTP.

A JSON object in the runtime directory, rewritten once a second by the heartbeat. It
counts only while it is fresh, by the clock that all processes of one boot share.
"""

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.health.health import Status
from x2radar.atomic import write_atomically

STALE_S = 10.0  # ten beats


@dataclass(frozen=True, slots=True)
class StatusReport:
    """What a status file says: whether all is well, one line for people, all of it."""

    is_healthy: bool
    line: str
    content: dict[str, Any]


def status_path(folder: Path, sensor: str) -> Path:
    """Return the status file of a sensor."""
    return folder / f"{sensor}.status.json"


def write_status(path: Path, status: Status, more: Mapping[str, Any]) -> None:
    """Write the file, for everybody who can see the folder to read; raises OSError."""
    content = {
        "state": status.state,
        "reason": status.reason,
        "pid": os.getpid(),
        "t_mono_s": round(time.monotonic(), 3),
        **more,
    }
    write_atomically(path, json.dumps(content) + "\n", sync=False)


def read_status(path: Path, *, stale_s: float = STALE_S) -> StatusReport:
    """Read a status file; whatever is wrong with it is an unhealthy report, never an error."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        status = Status(content["state"], content["reason"])
        age_s = time.monotonic() - float(content["t_mono_s"])
    except FileNotFoundError:
        return StatusReport(False, f"no radard runs here: no {path}", {})
    except (OSError, ValueError, KeyError, TypeError) as err:
        return StatusReport(False, f"{path}: cannot be read ({err})", {})
    if not age_s >= -1:
        return StatusReport(False, f"{path}: left over from before the last boot", content)
    if age_s > stale_s and status.state != "offline":
        return StatusReport(False, f"stuck or killed: silent for {age_s:.0f} s", content)
    return StatusReport(status.is_well, str(status), content)
