"""A clip's pictures and decisions for a page: u32 length of the JSON, the JSON, then columns.

They are made by this file as a program, with limits on time and memory: a damaged HDF5 file can
keep its reader busy for minutes, without letting go of the interpreter, or ask for gigabytes. In a
process of its own that costs the page an answer and decisions nothing.
"""

import asyncio
import contextlib
import json
import os
import resource
import struct
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from radard.clips.spectrogram_png import PictureMaker
from radard.errors import RadardError
from radard.web.pictures.wire import axes, encode_columns
from x2radar.errors import RecordingError
from x2radar.recording.hdf5_reader import Hdf5File
from x2radar.recording.registry import open_recording

DEADLINE_S = 20.0  # the longest clip, eleven minutes, takes some seconds
_BLOCK = 32  # frames at once: half a second
_MAX_S = 660.0  # above the longest clip, clips.longest_s of 600 s and its pre_s
_MAX_MEMORY = 2 << 30  # bytes of addresses: numpy, h5py and eleven minutes fit
_MAX_DECISIONS = 10_000  # one a second, of eleven minutes
_NICE = 10  # decisions come first
_KEYS = ("t_s", "seq", "gate", "label", "alarm", "fused_p_human", "fused_p_pet", "range_m")


async def read_clip(path: Path) -> bytes:
    """Return `clip_view` of a clip, made in another process; RadardError, TimeoutError."""
    environ = {
        "PYTHONPATH": os.pathsep.join(part for part in sys.path if part),
        # Others' stacks would count as memory, and decisions need the processor.
        "OPENBLAS_NUM_THREADS": "1",
        # A clip that is being written must come to its end, whatever reads it.
        "HDF5_USE_FILE_LOCKING": "FALSE",
    }
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "radard.web.pictures.clip_view", str(path)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | environ,
    )
    try:
        async with asyncio.timeout(DEADLINE_S):
            data, complaint = await process.communicate()
    except TimeoutError as err:
        msg = f"it took longer than {DEADLINE_S:g} s; the file may be damaged"
        raise TimeoutError(msg) from err
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        lines = complaint.decode(errors="replace").splitlines()
        raise RadardError(lines[-1] if lines else f"its reader ended with {process.returncode}")
    return data


def clip_view(path: Path) -> bytes:
    """Return the answer for a clip; X2RadarError, FeatureError or OSError if it is none."""
    with open_recording(path) as reader:
        stream = reader.stream
        maker = PictureMaker(stream, max(1, stream.axis.n_range // 96))
        frames = islice(reader.frames(0.0), int(_MAX_S * stream.frame_rate_hz))
        length_s = 0.0
        while block := list(islice(frames, _BLOCK)):
            length_s = (block[-1].index + 1) / stream.frame_rate_hz
            maker.push(block)
    columns, column_s = maker.columns(), maker.made.column_s
    head = {"length_s": length_s, "axes": axes(maker.made), "decisions": _decisions(path)}
    text = json.dumps(head).encode()
    shown = encode_columns(columns, first=0, epoch=0, column_s=column_s) if columns else b""
    return struct.pack("<I", len(text)) + text + shown


def _decisions(path: Path) -> list[dict[str, Any]]:
    """Return what was decided on the clip, on its own clock; nothing for a bare recording."""
    try:
        with contextlib.closing(Hdf5File(path)) as file:
            sets = [file.data_set(f"decisions/{key}") for key in _KEYS]
            if any(each is None or each.ndim != 1 for each in sets):
                return []
            columns = [file.read(each, slice(_MAX_DECISIONS)) for each in sets]
    except (RecordingError, OSError):
        return []
    rows = zip(*columns, strict=False)
    return [dict(zip(_KEYS, map(_plain, row), strict=True)) for row in rows]


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    number = value.item()
    return None if isinstance(number, float) and not np.isfinite(number) else number


def main(path: str) -> int:
    """Write the answer for a clip to stdout, within limits; return the exit code."""
    os.nice(_NICE)
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    try:
        data = clip_view(Path(path))
    except MemoryError:
        sys.stderr.write("it asks for too much memory; the file may be damaged\n")
        return 1
    except Exception as err:  # noqa: BLE001 - h5py raises all kinds of errors on damaged files
        sys.stderr.write(" ".join(str(err).split())[:500] + "\n")
        return 1
    sys.stdout.buffer.write(data)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
