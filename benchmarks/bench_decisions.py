"""What the shipped model decides on the simulated bodies, seed by seed.

For every scene and seed the daemon's own command runs 30 s. A window is one decision;
windows with a closed gate are counted apart, because nobody is judged in them.
"""

import argparse
import io
import json
from contextlib import redirect_stdout

from radard.cli import main as radard


def windows(scene: str, seed: int, duration_s: float) -> list[dict[str, object]]:
    """Return the decisions of one run."""
    out = io.StringIO()
    with redirect_stdout(out):
        code = radard(
            [
                "--port",
                f"sim:{scene}?seed={seed}",
                "--speed",
                "max",
                "--duration",
                str(duration_s),
                "-o",
                "json",
            ]
        )
    assert code == 0
    records = [json.loads(line) for line in out.getvalue().splitlines()]
    return [r for r in records if r["type"] == "decision"]


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--duration", type=float, default=30.0)
    args = parser.parse_args()
    result: dict[str, object] = {"seeds": args.seeds, "duration_s": args.duration}
    for scene in ("thesis_human", "thesis_dog", "thesis_cat", "empty", "human", "dog", "cat"):
        runs = [windows(scene, seed, args.duration) for seed in range(args.seeds)]
        every = [d for run in runs for d in run]
        judged = [d for d in every if d["gate"] == "open"]
        quiet = [d for d in judged if not d["alarm"]]
        result[scene] = {
            "windows": len(every),
            "gate_open": len(judged),
            "share_without_alarm_all": round(
                sum(not d["alarm"] for d in every) / max(len(every), 1), 4
            ),
            "share_without_alarm_open": round(len(quiet) / len(judged), 4) if judged else None,
            "runs_with_alarm": sum(any(d["alarm"] for d in run) for run in runs),
        }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
