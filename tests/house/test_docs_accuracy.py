"""docs/accuracy.md tells the rates of the default bundle's card."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_a_night_with_a_pet_is_what_the_card_says():
    made = subprocess.run(
        [sys.executable, "tools/home_rows.py"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([".", "daemon"])},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert made.count("\n") == 7
    assert made in (ROOT / "docs" / "accuracy.md").read_text("utf-8")
