"""How much a recording loses when its recorder is killed.

A recorder on a simulated module is killed with SIGKILL at random moments after its file has
appeared; then the file is read. Lost are the frames that the recorder had taken (it says so
on its stderr, frame by frame) and the file does not hold. The last line is one JSON object:
kills, readable (files that could be read), frames_lost_max.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from x2radar.errors import RecordingError
from x2radar.recording.registry import open_recording

RECORDER = """
import os, sys
from x2radar.recording.hdf5_writer import RecordingWriter
plain = RecordingWriter.write
def write(self, frame):
    plain(self, frame)
    os.write(2, b"%d\\n" % frame.index)
RecordingWriter.write = write
from x2radar.cli import main
sys.exit(main(sys.argv[1:]))
"""


def one_kill(path: Path, wait_s: float, options: list[str]) -> tuple[bool, int]:
    """Record, kill after `wait_s`; return whether the file is readable, and frames lost."""
    with (path.parent / "said").open("w+b") as said:
        process = subprocess.Popen(
            [sys.executable, "-c", RECORDER, "record", str(path), *options], stderr=said
        )
        pattern = f"{path.stem}*{path.suffix}"
        while not list(path.parent.glob(pattern)) and process.poll() is None:
            time.sleep(0.001)
        time.sleep(wait_s)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        said.seek(0)
        taken = said.read().count(b"\n")
    try:
        with open_recording(path) as reader:
            indices = [
                frame.index for frame in reader.frames() if np.isfinite(frame.samples).all()
            ]
    except RecordingError as err:
        print(f"unreadable: {err}")
        return False, taken
    whole = indices == list(range(len(indices)))
    return whole, max(0, taken - len(indices))


def main() -> None:
    """Kill again and again, print what was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", default="20", help="of the simulated module")
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - no secret
    readable, worst = 0, 0
    for k in range(args.kills):
        options = ["--port", f"sim:dog?seed={k}", "--speed", args.speed]
        # Every other one in parts, so that kills meet the change of parts, too.
        options += ["--rotate-time", "1.5"] if k % 2 else []
        with tempfile.TemporaryDirectory() as folder:
            good, lost = one_kill(Path(folder) / "k.h5", rng.uniform(0, 1.0), options)
        readable += good
        worst = max(worst, lost)
        print(f"kill {k + 1}: {'readable' if good else 'NOT READABLE'}, {lost} frames lost")
    print(json.dumps({"kills": args.kills, "readable": readable, "frames_lost_max": worst}))


if __name__ == "__main__":
    main()
