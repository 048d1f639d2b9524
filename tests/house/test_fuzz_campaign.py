"""The fuzzing campaign itself: its short form, its counts, its seeds."""

import json
import subprocess
import sys
import warnings

from campaigns import fuzz
from campaigns.fuzz_mutate import BORDER
from campaigns.fuzz_targets import TARGETS
from tests.hostile_helpers import ROOT


def test_the_short_campaign_finds_nothing(tmp_path):
    done = subprocess.run(
        [sys.executable, "campaigns/fuzz.py", "--inputs", "40", "--keep", str(tmp_path / "found")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    targets = summary.pop("targets")
    assert summary == {"inputs": 40 * len(TARGETS), "unhandled": 0, "hangs": 0, "over_memory": 0}
    assert list(targets) == list(fuzz.TARGETS) == list(TARGETS)
    assert not (tmp_path / "found").exists()


def test_good_inputs_are_read(tmp_path):
    """The campaign begins with files that reach far into the readers."""
    for name, target in TARGETS.items():
        folder = tmp_path / name
        (folder / "seeds").mkdir(parents=True)
        (folder / "work").mkdir()
        seeds = target.seeds(folder / "seeds")
        good = seeds[2] if name == "scene" else seeds[0]
        with warnings.catch_warnings():
            target.run(folder / "work", good)


def test_what_goes_wrong_is_counted_and_kept(tmp_path):
    """Inputs that raise, hang, grow and kill their process, by a target that does all that."""
    code = (
        "import os, sys; sys.path[:0] = ['.', 'daemon']\n"
        "from campaigns import fuzz, fuzz_targets\n"
        "def run(folder, data): exec(data)\n"
        "bad = fuzz_targets.Target('bad', run, lambda folder: [b'pass'])\n"
        "fuzz_targets.TARGETS = {'bad': bad}\n"
        "fuzz.main()\n"
    )
    (tmp_path / "bad.py").write_text(code)
    worker = fuzz.Worker(("bad",), tmp_path, program=str(tmp_path / "bad.py"))
    campaign = fuzz.Campaign(tmp_path / "found", worker)
    inputs = [
        b"pass",
        b"from x2radar.errors import SceneError; raise SceneError('as it should be')",
        b"raise KeyError(1)",
        b"while True: pass",
        b"import os; os.abort()",
        b"x = bytearray(600 << 20)",
        b"pass",
    ]
    try:
        campaign.feed("bad", iter(inputs))
    finally:
        worker.close()
    assert campaign.summary()["targets"]["bad"] == {
        "inputs": 7,
        "unhandled": 2,
        "hangs": 1,
        "over_memory": 1,
    }
    assert sorted(path.read_bytes() for path in (tmp_path / "found").iterdir()) == sorted(
        inputs[2:6]
    )


def test_the_same_seed_makes_the_same_inputs():
    def inputs(seed):
        seeds = [b"one: 1\n", b"\x89HDF\0\0" * 20 + BORDER + b"two"]
        return list(fuzz.mutations("scene", seed, 200, float("inf"), seeds))

    assert inputs(1) == inputs(1) != inputs(2)
