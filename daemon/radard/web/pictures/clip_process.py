"""Clip pictures in a process of their own, with limits on time and memory.

A damaged HDF5 file can keep its reader busy for minutes, without letting go of the interpreter,
or ask for gigabytes. In a process of its own that costs the page an answer and decisions nothing.
"""

import asyncio
import contextlib
import os
import sys
from pathlib import Path

from radard.errors import RadardError

DEADLINE_S = 20.0  # the longest clip, eleven minutes, takes some seconds


class ClipTimeoutError(RadardError):
    """A clip was not read within `DEADLINE_S`."""


async def read_clip(path: Path) -> bytes:
    """Return `clip_view` of a clip, made in another process; RadardError, ClipTimeoutError."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "radard.web.pictures.clip_view", str(path)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=environ(),
    )
    try:
        async with asyncio.timeout(DEADLINE_S):
            data, complaint = await process.communicate()
    except TimeoutError as err:
        msg = f"it took longer than {DEADLINE_S:g} s; the file may be damaged"
        raise ClipTimeoutError(msg) from err
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        lines = complaint.decode(errors="replace").splitlines()
        raise RadardError(lines[-1] if lines else f"its reader ended with {process.returncode}")
    return data


def environ() -> dict[str, str]:
    """Return the environment of the process that reads."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(part for part in sys.path if part),
        # Others' stacks would count as memory, and decisions need the processor.
        "OPENBLAS_NUM_THREADS": "1",
        # A clip that is being written must come to its end, whatever reads it.
        "HDF5_USE_FILE_LOCKING": "FALSE",
    }
