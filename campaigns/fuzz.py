"""Bad input: mutated and hostile files at every reader; what is not refused cleanly is counted.

    python campaigns/fuzz.py --seconds 600 --keep found/
    python campaigns/fuzz.py --inputs 50 --targets hdf5,npz      # the same inputs each time

Targets (`fuzz_targets`, `fuzz_network`) are the readers of all files, and of what comes over a
network. An input is run in a process of its own kind, which dies with it if it must: 3 s of its
processor's time (or 60 s by the clock) is a hang, and the address space may grow by 512 MiB over
what the imports took. Right is a result or one of the project's own errors.

All inputs are mutations of good ones by a seeded generator. The last line is one JSON object:
inputs and the harm, which gives exit code 1, also of each of `targets`.
"""

import hashlib
import math
import os
import random
import re
import resource
import signal
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import islice, takewhile
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from campaigns.fuzz_network import BORDER
from campaigns.fuzz_targets import TARGETS, verdict
from campaigns.processes import end_with, parser_of
from x2radar.recording.hdf5_reader import lookup3

MAX_GROWTH_BYTES = 512 << 20
TIME_LIMIT_S = 3.0
_CLOCK_LIMIT_S = 60.0  # by the clock, for an input that waits; busy machines take long
_NUMBERS = (0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFF)
_LONG = (1 << 40, (1 << 63) - 1, (1 << 64) - 1)
_WORDS = (
    *b'null true [] {} "" -1 0 1e999 -1e999 NaN 1e300 Infinity "\\ud800" "a" [[1]] ~ *a'.split(),
    *b"!!python/none 2001-02-30 1:2:3 1_0 .inf \xff \xed\xa0\x80".split(),
    *(b"<<: ", b"&a ", b"&a [*a]", b"? ", b"- ", b"\t", b"\x00", b"0x" + b"F" * 300),
    *(b"9" * 40, b"9" * 400, b"9" * 5000, b"[" * 3000, b'{"a":' * 3000),
)
"""Values that YAML, JSON and Python read in ways of their own, or that cost them much."""
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_TEXT = re.compile(rb'"[^"\n]{0,60}"|[A-Za-z_][A-Za-z0-9_]{2,}')


class Worker:
    """A process that runs inputs, and is started again when it has died."""

    def __init__(self, targets: Sequence[str], folder: Path) -> None:
        self._arguments = (targets, folder / "work")
        (folder / "work").mkdir(exist_ok=True)
        self._process: SpawnProcess | None = None

    def run(self, target: str, data: bytes) -> tuple[str, str]:
        """Return what became of an input: fine, unhandled, hangs or over_memory, and a line."""
        process = self._process or self._start()
        try:
            self._pipe.send((target, data))
            found: tuple[str, str] = self._pipe.recv()
        except (EOFError, OSError):
            process.join()
            code = process.exitcode or 0
            self.close()
            if -code in {signal.SIGPROF, signal.SIGALRM}:
                return "hangs", f"more than {TIME_LIMIT_S:g} s"
            name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            return "unhandled", f"the process died of {name}"
        return found

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
        self._pipe.recv()  # that it is ready
        return process


def work(pipe: Connection, targets: Sequence[str], folder: Path) -> None:
    """Run inputs that come with the name of their target; answer each with what became of it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)

    def run(target: str, data: bytes) -> tuple[str, str]:
        for path in folder.iterdir():
            path.unlink()
        return verdict(partial(TARGETS[target][0], folder, data))

    for name in targets:
        # What is imported late is not the input's.
        run(name, _seeds(name)[0])
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MAX_GROWTH_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    pipe.send("ready")
    while True:
        target, data = pipe.recv()
        # Nobody handles these signals: the process dies of them.
        signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT_S)
        signal.setitimer(signal.ITIMER_REAL, _CLOCK_LIMIT_S)
        made = run(target, data)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        pipe.send(made)


def fed(
    worker: Worker, target: str, inputs: Iterator[bytes], keep: Path | None, until_s: float
) -> Counter[str]:
    """Run inputs of one target for so long; keep those that are not right, return counts."""
    count = Counter[str]()
    for data in takewhile(lambda _: time.monotonic() < until_s, inputs):
        count["inputs"] += 1
        kind, text = worker.run(target, data)
        if kind == "fine":
            continue
        count[kind] += 1
        name = f"{target}-{kind}-{hashlib.sha256(data).hexdigest()[:12]}"
        print(f"{name}: {text[:200]}", file=sys.stderr)
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / name).write_bytes(data)
    return count


def mutations(target: str, seed: int) -> Iterator[bytes]:
    """Yield the good inputs, then mutations of them without end."""
    rng = random.Random(f"{target} {seed}")  # noqa: S311 - no secret
    seeds = _seeds(target)
    yield from seeds
    while True:
        parts = rng.choice(seeds).split(BORDER)
        k = rng.randrange(len(parts))
        parts[k] = mutate(rng, parts[k], seeds)
        yield BORDER.join(parts)


def _seeds(target: str) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return TARGETS[target][1](Path(folder))


def mutate(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Return `data` with one to six changes; `others` lend parts."""
    out = bytearray(data or rng.choice(_WORDS))
    is_text = b"\0" not in data[:512]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        change = rng.choice(_TEXT_CHANGES if is_text and rng.random() < 0.8 else _CHANGES)
        if not (out := _changed(change, rng, out, others)):
            break
    if out[:8] == b"\x89HDF\r\n\x1a\n" and rng.random() < 0.6:
        _mend_checksums(out)
    return bytes(out)


_CHANGES = ("flip", "flip", "number", "number", "float", "cut", "drop", "again")
_TEXT_CHANGES = ("token", "token", "token", "line", "word", "drop", "again", "cut")


def _changed(
    change: str, rng: random.Random, out: bytearray, others: Sequence[bytes]
) -> bytearray:
    # Heads are denser in meaning than what follows them.
    at = rng.randrange(len(out) if rng.random() < 0.5 else min(len(out), 256))
    match change:
        case "flip":
            out[at] ^= 1 << rng.randrange(8)
        case "number" | "float":
            at, piece = (at, _float(rng)) if change == "float" else _number(rng, at)
            out[at : at + len(piece)] = piece[: len(out) - at]
        case "cut":
            return out[: rng.randrange(len(out) + 1)]
        case "drop":
            del out[at : at + rng.choice((1, 2, 4, 8, 64, 1000))]
        case "again":
            source = bytes(out) if rng.random() < 0.5 or not others else rng.choice(others)
            begin, n = rng.randrange(len(source) or 1), rng.choice((1, 4, 8, 32, 256, 2000))
            piece = source[begin : begin + n] * rng.choice((1, 1, 1, 20))
            out[at : at + (len(piece) if rng.random() < 0.5 else 0)] = piece
        case "word":
            out[at:at] = rng.choice(_WORDS)
        case "token":
            # A strange value, or another of the same text, where a number or a word stands.
            if found := list(rng.choice((_NUMBER, _TEXT)).finditer(bytes(out))):
                begin, end = rng.choice(found).span()
                other = rng.choice(found).group()
                out[begin:end] = other if rng.random() < 0.3 else rng.choice(_WORDS)
        case "line":
            return _line(rng, out, others)
    return out


def _number(rng: random.Random, at: int) -> tuple[int, bytes]:
    """Return a whole number, and where to put it: aligned, most often."""
    width = rng.choice((1, 2, 4, 4, 8))
    value = rng.choice((*_NUMBERS, *_LONG, rng.getrandbits(32))) & ((1 << 8 * width) - 1)
    if rng.random() < 0.7:
        at -= at % min(width, 4)
    return at, value.to_bytes(width, rng.choice(("little", "big")))


def _float(rng: random.Random) -> bytes:
    value = rng.choice((float("nan"), float("inf"), -float("inf"), 0.0, -1.0, 1e300, 1e-320, 1e30))
    if rng.random() < 0.5:
        return struct.pack("<d", value)
    return struct.pack("<f", 3e38 if 3e38 < abs(value) < math.inf else value)


def _line(rng: random.Random, out: bytearray, others: Sequence[bytes]) -> bytearray:
    """Drop, repeat or indent a line, or take one of another file."""
    lines = bytes(out).split(b"\n")
    k = rng.randrange(len(lines))
    foreign = rng.choice(rng.choice(others or [bytes(out)]).split(b"\n"))
    indented = b"  " * rng.randrange(4) + lines[k].lstrip()
    lines[k : k + 1] = rng.choice(
        ([], [lines[k]] * rng.choice((2, 4)), [indented], [foreign, lines[k]])
    )
    return bytearray(b"\n".join(lines))


def _mend_checksums(out: bytearray) -> None:
    """Give the superblock, object headers and chunk indices of an HDF5 file good checksums."""
    if len(out) > 48 and out[8] in {2, 3}:
        struct.pack_into("<I", out, 44, lookup3(bytes(out[:44])))
    for found in re.finditer(rb"OHDR\x02|EAHD\x00", bytes(out)):
        at, n = found.start(), 68
        if found.group().startswith(b"O"):
            # Of an object header (version 2): what lies before its checksum.
            flags = out[at + 5] if at + 5 < len(out) else 0
            begin = at + 6 + 16 * bool(flags & 0x20) + 4 * bool(flags & 0x10)
            end = begin + (1 << (flags & 3))
            n = end - at + int.from_bytes(out[begin:end], "little")
        if at + n + 4 <= len(out):
            struct.pack_into("<I", out, at + n, lookup3(bytes(out[at : at + n])))


def main() -> int:
    """Run the campaign."""
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for all targets together")
    parser.add_argument("--inputs", type=int, help="of each target, instead of --seconds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", default=",".join(TARGETS), help="some, with commas")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="write what was found there")
    args = parser.parse_args()
    targets = args.targets.split(",")
    share_s = float("inf") if args.inputs else args.seconds / len(targets)
    each: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder, closing(Worker(targets, Path(folder))) as worker:
        for target in targets:
            inputs = islice(mutations(target, args.seed), args.inputs)
            count = fed(worker, target, inputs, args.keep, time.monotonic() + share_s)
            print(f"{target}: {dict(count)}", file=sys.stderr)
            each[target] = count
    return end_with({**sum(each.values(), Counter[str]()), "targets": each})


if __name__ == "__main__":
    sys.exit(main())
