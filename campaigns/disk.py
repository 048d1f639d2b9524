"""The disk of the state directory, store, clips and recordings is full, low, slow or fails.

    python campaigns/disk.py --faults 200
    python campaigns/disk.py --faults 6      # the short form

A daemon on a simulated module with people in it keeps all that it keeps on a disk of its own, a
small one in memory (which takes root's rights to mount). What happens to that comes at random
moments, a third of it over the end of one daemon and the start of the next: it is full, or all but
full; every write waits, is refused as on a disk that is read-only, or fails (by a layer before the
C library, `disk_layer.c`, which takes a compiler); or pages of a file are overwritten: of the
event log, the store, a clip or a recording.

The last line is one JSON object: faults, by their kind; skipped (kinds that this computer cannot
have); events; decisions (those compared); lost_events (that did not come to the broker, or to the
store, although that was whole); duplicate_events (a number, a key or a row used twice); unreadable
(a clip that an event names, that is not there and of whose loss the log says nothing);
silent_stalls (no decision while it lasted, or not a word of it); unrecovered (not well again
afterwards); decisions_differ (from a run where nothing happened); crashes. Exit code 1 if harm was
found.
"""

import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from sqlite3 import DatabaseError
from unittest.mock import patch

_ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(_ROOT), str(_ROOT / "daemon")]

from campaigns.kept import PORT, Kept, alarm_again, reference  # noqa: E402 - below the path
from campaigns.outputs import Broker, Outputs  # noqa: E402
from campaigns.processes import CONFIG, Daemon, end_with, parser_of, wait_for  # noqa: E402

_MODES = {"slow": b"s", "read_only": b"r", "broken": b"e"}
_KINDS = ("full", "low", *_MODES, "corrupt")
_MB = 20
_LASTS_S = (1.0, 8.0)
_CONFIG = {
    **CONFIG,
    "sensor": {"port": PORT, "speed": "4"},
    "clips": {"keep_mb": 4, "free_mb": 3, "longest_s": 20, "pre_s": 4},
}


class Disk:
    """A small disk, and what may happen to it."""

    def __init__(self, folder: Path, mode: Path, rng: random.Random, stack: ExitStack) -> None:
        self.folder, self._mode, self._rng = folder, mode, rng
        self._layer = mode.with_suffix(".so")
        self.skipped: set[str] = set()
        self._mode.write_bytes(b"-")
        mount = ("mount", "-t", "tmpfs", "-o", f"size={_MB}m", "tmpfs", str(folder))
        build = ("gcc", "-shared", "-fPIC", "-O1", "-o", str(self._layer))
        if _does(*mount):
            stack.callback(_does, "umount", "-l", str(folder))
        else:
            self.skipped |= {"full", "low"}
        if not _does(*build, str(Path(__file__).parent / "disk_layer.c"), "-ldl"):
            self.skipped |= set(_MODES)

    def environment(self) -> dict[str, str]:
        """Return what puts the layer before a process."""
        own = {"DISK_MODE": str(self._mode), "DISK_FOLDER": str(self.folder)}
        return {**own, "LD_PRELOAD": str(self._layer)} if self._layer.exists() else {}

    def fail(self, kind: str) -> str:
        """Let something happen; return what is to be known of it."""
        if kind in _MODES:
            with self._mode.open("r+b") as file:
                file.write(_MODES[kind])
        elif kind == "corrupt":
            return self._corrupt()
        else:
            left = 0 if kind == "full" else self._rng.randint(20_000, 2_000_000)
            with suppress(OSError), (self.folder / "filler").open("wb", buffering=0) as file:
                while (free := shutil.disk_usage(self.folder).free) > left:
                    file.write(bytes(min(65_536, max(1, free - left))))
        return kind

    def heal(self) -> None:
        """Let it be well."""
        with self._mode.open("r+b") as file:
            file.write(b"-")
        (self.folder / "filler").unlink(missing_ok=True)

    def _corrupt(self) -> str:
        """Overwrite some pages of one file; return its name."""
        files = [p for p in self.folder.rglob("*") if p.suffix in {".db", ".db-wal", ".h5"}]
        files = [p for p in files if p.stat().st_size]
        path = self._rng.choice(sorted(files))
        with suppress(FileNotFoundError), path.open("r+b") as file:
            times = os.fstat(file.fileno())
            for _ in range(self._rng.randint(1, 4)):
                file.seek(4096 * self._rng.randrange(1 + path.stat().st_size // 4096))
                file.write(self._rng.randbytes(self._rng.randint(1, 4096)))
            # A disk that goes bad dates nothing: clips go by their dates.
            file.flush()
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        return f"corrupt {path.name}"


class Guard:
    """A daemon on such a disk, and what it kept."""

    def __init__(self, folder: Path, broker: Broker, rng: random.Random, stack: ExitStack) -> None:
        self._home, self._rng = folder / "radard", rng
        self._outputs = Outputs(folder, broker)
        self.disk = Disk(self._outputs.store.parent, folder / "mode", rng, stack)
        self._state = self.disk.folder / "state"
        self.kept = Kept(self._outputs, self._state)
        self._is_damaged = False
        self.kinds: Counter[str] = Counter()
        self.found = dict.fromkeys(("crashes", "silent_stalls", "unrecovered"), 0)
        self._daemon = self._started()
        self._goes_on("at the start")

    def once(self, kind: str) -> None:
        """Let one thing happen to the disk, for a while."""
        self.kinds[kind] += 1
        alarm_again(self._daemon)
        time.sleep(self._rng.uniform(0.0, 2.0))
        what = self.disk.fail(kind)
        if kind == "corrupt":
            self._is_damaged = True
        if self._rng.random() < 1 / 3:
            what += ", started again"
            self.stop(is_slow=kind == "slow")
            # What only the memory of the one that ended had is gone by right.
            self._is_damaged = True
            self._daemon = self._started()
        alarm_again(self._daemon)
        self._goes_on(what)
        if kind in {"full", "read_only", "broken"}:
            self._says(what)
        time.sleep(self._rng.uniform(*_LASTS_S))
        self.disk.heal()
        self._goes_on(f"after {what}")
        self._recovers(what)
        if self._is_damaged:
            self.kept.begin_again()
        with suppress(DatabaseError):
            # Of a page that it has not read again yet nobody knows.
            self.kept.look()
        self.kept.look_at_clips(self._daemon.log)
        for path in self.disk.folder.glob("rec*.h5"):
            path.unlink()

    def finish(self) -> int:
        """Let all events arrive; return how many there were."""
        with suppress(TimeoutError):
            wait_for(lambda: not self._missing(), "events at the broker")
        for row in (missing := self._missing()):
            self.kept.found["lost_events"] += 1
            print(f"lost: {row} of {len(missing)}", file=sys.stderr)
        self.stop()
        return len({row["id"] for row in self._outputs.records("event")})

    def stop(self, *, is_slow: bool = False) -> None:
        """End the daemon, once everybody has heard of all events.

        Where every write waits it may end by force, if it says so.
        """
        with suppress(TimeoutError):
            wait_for(lambda: not self._untold(), "events at the broker", 20)
        n_before = len(self._daemon.log)
        code = self._daemon.stop()
        is_forced = is_slow and "not ended in" in self._daemon.log[n_before:]
        if is_forced:
            self.kept.end_by_force()
        if (code != 0 and not is_forced) or "Traceback" in self._daemon.log:
            self.found["crashes"] += 1
            print(f"ended with {code}: {self._daemon.log[-3000:]}", file=sys.stderr)

    def _started(self) -> Daemon:
        config = {**_CONFIG, "service": {"state_dir": str(self._state)}}
        record = ("--record", str(self.disk.folder / "rec.h5"))
        with patch.dict(os.environ, self.disk.environment()):
            return Daemon(self._home, *record, *self._outputs.arguments, config=config)

    def _goes_on(self, what: str) -> None:
        first = self._n_told()
        n = self._rng.randint(3, 12)
        self._expect("silent_stalls", what, lambda: self._n_told() >= first + n)

    def _says(self, what: str) -> None:
        """Wait until it says that something is wrong."""
        state = lambda: self._daemon.status().get("state")  # noqa: E731
        self._expect("silent_stalls", f"{what}: not said", lambda: state() == "degraded")

    def _recovers(self, what: str) -> None:
        """Wait until only what lasts is said: a recording that ended, a file put aside."""

        def is_well() -> bool:
            reason = str(self._daemon.status().get("reason", "memory only"))
            return "memory only" not in reason and "cannot keep" not in reason

        self._expect("unrecovered", what, is_well)

    def _expect(self, key: str, what: str, condition: Callable[[], object]) -> None:
        try:
            wait_for(lambda: condition() or not self._daemon.is_alive, what, 60)
        except TimeoutError:
            self.found[key] += 1
            print(f"{key}: {what}: {self._daemon.status()}", file=sys.stderr)
        if not self._daemon.is_alive:
            self.found["crashes"] += 1
            print(f"{what}: it ended: {self._daemon.log[-3000:]}", file=sys.stderr)
            self.disk.heal()
            self._daemon = self._started()

    def _untold(self) -> set[tuple[str, str]]:
        came = {(row["id"], row["phase"]) for row in self._outputs.broker.events()}
        return {(row["id"], row["phase"]) for row in self._outputs.records("event")} - came

    def _missing(self) -> set[tuple[str, str]]:
        """Return what nobody heard of, or the store lacks although it was whole all the time."""
        if self._is_damaged:
            return self._untold()
        with suppress(DatabaseError):
            return self._outputs.missing()
        return {("store", "unreadable")}

    def _n_told(self) -> int:
        return sum(1 for _ in self._outputs.records("decision"))


def _does(*command: str) -> bool:
    with suppress(OSError):
        return subprocess.run(command, check=False, capture_output=True).returncode == 0
    return False


def main() -> int:
    """Let it happen again and again."""
    parser = parser_of(__doc__)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - no secret
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        broker = stack.enter_context(Broker(folder))
        expected = reference(folder, _CONFIG, 60 if args.faults < 10 else 600)
        guard = Guard(folder, broker, rng, stack)
        try:
            for k in range(args.faults):
                kind = _KINDS[k % len(_KINDS)]
                if kind not in guard.disk.skipped:
                    guard.once(kind)
            events = guard.finish()
        finally:
            guard.disk.heal()
            guard.stop()
        decisions = guard.kept.look_at_decisions(expected)
    counts = {"faults": dict(guard.kinds), "skipped": sorted(guard.disk.skipped)}
    counts |= {"events": events, "decisions": decisions}
    return end_with({**counts, **guard.found, **guard.kept.found})


if __name__ == "__main__":
    sys.exit(main())
