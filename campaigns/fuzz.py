"""Bad input: mutated and hostile files at every reader; what is not refused cleanly is counted.

    python campaigns/fuzz.py --seconds 600 --keep found/
    python campaigns/fuzz.py --inputs 50 --targets hdf5,npz      # the same inputs each time

Targets are the decoder, recordings (HDF5, XeThru, FrameLogger, P4xx .mat, npz, SigMF, wire
captures), scenes, the configuration, model bundles (sidecar and ONNX), calibrations, kept state,
and what comes over a network: requests, messages of pages, commands over MQTT, what a module says
of itself in Home Assistant's discovery, and what a broker says of a fleet. An input is run in a
process of its own kind, which dies with it if it must: 3 s of its processor's time (or 60 s by
the clock) is a hang, and the address space may grow by 512 MiB over what the imports took; more
is counted as over_memory. Right is a result or one of the project's own errors; any other
exception, or the death of the process, is unhandled.

All inputs are mutations of good ones by a seeded generator. The last line is one JSON object:
inputs, unhandled, hangs, over_memory, and the same for each of `targets`. Exit code 1 if harm was
found.
"""

import hashlib
import importlib
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

_ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(_ROOT), str(_ROOT / "daemon")]
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from campaigns import fuzz_targets  # noqa: E402 - below the path
from campaigns.fuzz_mutate import BORDER, mutate  # noqa: E402
from campaigns.processes import end_with, parser_of  # noqa: E402

MAX_GROWTH_BYTES = 512 << 20
TIME_LIMIT_S = 3.0
_CLOCK_LIMIT_S = 60.0
"""By the clock, for an input that waits; busy machines take long over little work."""
_START_LIMIT_S = 120.0
_KEYS = ("inputs", "unhandled", "hangs", "over_memory")


class Worker:
    """A process that runs inputs, and is started again when it has died.

    `module` has the table of targets.
    """

    def __init__(
        self, targets: Sequence[str], folder: Path, module: str = "campaigns.fuzz_targets"
    ) -> None:
        self._arguments = (targets, folder / "work", module)
        (folder / "work").mkdir(exist_ok=True)
        self._process: SpawnProcess | None = None

    def run(self, target: str, data: bytes) -> tuple[str, str]:
        """Return what became of an input: fine, unhandled, hangs or over_memory, and a line."""
        process = self._process or self._start()
        assert process.pid is not None
        begun_s, give_up_s = _cpu_s(process.pid), time.monotonic() + _CLOCK_LIMIT_S
        self._pipe.send((target, data))
        while not self._pipe.poll(TIME_LIMIT_S):
            if _cpu_s(process.pid) - begun_s > TIME_LIMIT_S or time.monotonic() > give_up_s:
                self.close()
                return "hangs", f"more than {TIME_LIMIT_S:g} s"
        try:
            kind, text = self._pipe.recv()
        except (EOFError, OSError):
            process.join()
            code = process.exitcode or 0
            self.close()
            name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            return "unhandled", f"the process died of {name}"
        return kind, text

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = None

    def _start(self) -> SpawnProcess:
        spawn = get_context("spawn")
        self._pipe, far = spawn.Pipe()
        self._process = process = spawn.Process(target=work, args=(far, *self._arguments))
        process.start()
        far.close()
        if not self._pipe.poll(_START_LIMIT_S):
            msg = "the process for inputs does not start"
            raise RuntimeError(msg)
        self._pipe.recv()
        return process


def _cpu_s(pid: int) -> float:
    """Return the processor time that a process has used."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def work(pipe: Connection, targets: Sequence[str], folder: Path, module: str) -> None:
    """Run inputs that come with the name of their target; answer each with what became of it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    known = importlib.import_module(module).TARGETS

    def run(target: str, data: bytes) -> tuple[str, str]:
        for path in folder.iterdir():
            path.unlink()
        return fuzz_targets.verdict(partial(known[target].run, folder, data))

    for name in targets:
        # What is imported late is not the input's.
        with tempfile.TemporaryDirectory() as own:
            run(name, known[name].seeds(Path(own))[0])
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MAX_GROWTH_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    pipe.send("ready")
    while True:
        pipe.send(run(*pipe.recv()))


class Campaign:
    """Counts what became of inputs, and keeps those that are not as they should be."""

    def __init__(self, keep: Path | None, worker: Worker) -> None:
        self._keep = keep
        self._worker = worker
        self.counts: dict[str, Counter[str]] = {}

    def feed(self, target: str, inputs: Iterator[bytes]) -> None:
        """Run inputs of one target."""
        count = self.counts.setdefault(target, Counter())
        for data in inputs:
            count["inputs"] += 1
            kind, text = self._worker.run(target, data)
            if kind == "fine":
                continue
            count[kind] += 1
            name = f"{target}-{kind}-{hashlib.sha256(data).hexdigest()[:12]}"
            print(f"{name}: {text[:200]}", file=sys.stderr)
            if self._keep is not None:
                self._keep.mkdir(parents=True, exist_ok=True)
                (self._keep / name).write_bytes(data)

    def summary(self) -> dict[str, object]:
        """Return what the last line says."""
        totals = {key: sum(count[key] for count in self.counts.values()) for key in _KEYS}
        each = {name: {key: count[key] for key in _KEYS} for name, count in self.counts.items()}
        return {**totals, "targets": each}


def mutations(
    target: str, seed: int, n: int | None, until_s: float, seeds: list[bytes]
) -> Iterator[bytes]:
    """Yield the good inputs, then mutations of them, until a number or a time is reached."""
    rng = random.Random(f"{target} {seed}")  # noqa: S311 - no secret
    done = 0
    while (n is None or done < n) and time.monotonic() < until_s:
        if done < len(seeds):
            yield seeds[done]
        else:
            parts = rng.choice(seeds).split(BORDER)
            k = rng.randrange(len(parts))
            parts[k] = mutate(rng, parts[k], seeds)
            yield BORDER.join(parts)
        done += 1


def _seeds(target: str) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return fuzz_targets.TARGETS[target].seeds(Path(folder))


def main() -> int:
    """Run the campaign."""
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for all targets together")
    parser.add_argument("--inputs", type=int, help="of each target, instead of --seconds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--targets", default=",".join(fuzz_targets.TARGETS), help="some, with commas"
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="write what was found there")
    args = parser.parse_args()
    targets = args.targets.split(",")
    share_s = float("inf") if args.inputs else args.seconds / len(targets)
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign(args.keep, worker := Worker(targets, Path(folder)))
        try:
            for target in targets:
                until_s = time.monotonic() + share_s
                seeds = _seeds(target)
                inputs = mutations(target, args.seed, args.inputs, until_s, seeds)
                campaign.feed(target, inputs)
                print(f"{target}: {dict(campaign.counts[target])}", file=sys.stderr)
        finally:
            worker.close()
    return end_with(campaign.summary())


if __name__ == "__main__":
    sys.exit(main())
