"""Time from starting the daemon to its first frame and first decision, as whole processes.

The daemon runs on the simulated module in real time, as it would on a port. Its first
decision needs 147 frames (2.45 s at 60 Hz); what lies beyond that is start-up.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time

FRAMES_S = 147 / 60


def once(arguments: list[str]) -> tuple[float, float]:
    """Return seconds to `hello` (the first frame is there) and to the first decision."""
    started_s = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "radard", *arguments, "-o", "json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    hello_s = decision_s = float("nan")
    for line in process.stdout:
        kind = json.loads(line)["type"]
        if kind == "hello":
            hello_s = time.perf_counter() - started_s
        elif kind == "decision":
            decision_s = time.perf_counter() - started_s
            break
    process.terminate()
    process.wait()
    return hello_s, decision_s


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=7)
    runs = parser.parse_args().runs
    port = ["--port", "sim:human"]
    once(port)
    hello, decision = zip(*(once(port) for _ in range(runs)), strict=True)
    listed = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from radard.cli import main; main(['--port', 'sim:human', '--speed', "
            "'max', '--duration', '3', '-o', 'null']); print('torch' in sys.modules)",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    print(
        json.dumps(
            {
                "runs": runs,
                "first_frame_s": round(statistics.median(hello), 3),
                "first_frame_max_s": round(max(hello), 3),
                "first_decision_s": round(statistics.median(decision), 3),
                "beyond_frames_s": round(statistics.median(decision) - FRAMES_S, 3),
                "torch_imported": listed.stdout.strip() == "True",
            }
        )
    )


if __name__ == "__main__":
    main()
