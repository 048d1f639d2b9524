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
have); events; decisions (those compared with a run where nothing happened); and the harm, which
gives exit code 1.
"""

import os
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from sqlite3 import DatabaseError
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.kept import BUSY, House, campaign
from tests.waiting import wait_for

_MODES = {"slow": b"s", "read_only": b"r", "broken": b"e"}
_KINDS = ("full", "low", *_MODES, "corrupt")
_MB = 20
_LASTS_S = (1.0, 8.0)
_CONFIG = {
    **BUSY,
    "clips": {"keep_mb": 4, "free_mb": 3, "longest_s": 20, "pre_s": 4},
}


def _does(*command: str) -> bool:
    """Run a command in silence; return whether that went well."""
    with suppress(OSError):
        return subprocess.run(command, check=False, capture_output=True).returncode == 0
    return False


class Guard(House):
    """A daemon on a small disk, and what may happen to that."""

    config = _CONFIG

    def __init__(self, folder: Path, rng: random.Random, stack: ExitStack) -> None:
        super().__init__(folder, rng, stack)
        self.disk, self._mode = self.store.parent, folder / "mode"
        self.state = self.disk / "state"
        self._is_damaged = False
        self.kinds: Counter[str] = Counter()
        self.skipped: set[str] = set()
        self._mode.write_bytes(b"-")
        if _does("mount", "-t", "tmpfs", "-o", f"size={_MB}m", "tmpfs", str(self.disk)):
            stack.callback(_does, "umount", "-l", str(self.disk))
        else:
            self.skipped |= {"full", "low"}
        layer = folder / "mode.so"
        build = ("gcc", "-shared", "-fPIC", "-O1", "-o", str(layer))
        if not _does(*build, str(Path(__file__).parent / "disk_layer.c"), "-ldl"):
            self.skipped |= set(_MODES)
        own = {"DISK_MODE": str(self._mode), "DISK_FOLDER": str(self.disk)}
        # What puts the layer before a process.
        self._environment = own | {"LD_PRELOAD": str(layer)} if layer.exists() else {}
        self.counts |= {"faults": self.kinds, "skipped": sorted(self.skipped)}
        self.start()
        self.goes_on(self.rng.randint(3, 12), "at the start")

    def start(self, *arguments: str) -> None:
        """Start the daemon on the disk, with a recording there."""
        with patch.dict(os.environ, self._environment):
            super().start("--record", str(self.disk / "rec.h5"), *arguments)

    def once(self, k: int) -> None:
        """Let one thing happen to the disk, for a while."""
        kind = _KINDS[k % len(_KINDS)]
        if kind in self.skipped:
            return
        self.kinds[kind] += 1
        self.alarm_again()
        time.sleep(self.rng.uniform(0.0, 2.0))
        what = self._fail(kind)
        if kind == "corrupt":
            self._is_damaged = True
        if self.rng.random() < 1 / 3:
            what += ", started again"
            self.stop(is_slow=kind == "slow")
            # What only the memory of the one that ended had is gone by right.
            self._is_damaged = True
            self.start()
        self.alarm_again()
        self.goes_on(self.rng.randint(3, 12), what)
        if kind in {"full", "read_only", "broken"}:
            self.expect("silent_stalls", f"{what}: not said", lambda: self.state_is("degraded"))
        time.sleep(self.rng.uniform(*_LASTS_S))
        self._heal()
        self.goes_on(self.rng.randint(3, 12), f"after {what}")
        self.expect("unrecovered", what, self._is_well)
        if self._is_damaged:
            self.begin_again()
        self.look()
        self.look_at_clips()
        for path in self.disk.glob("rec*.h5"):
            path.unlink()

    def look(self) -> None:
        """As in `House`; of a page that it has not read again yet nobody knows."""
        with suppress(DatabaseError):
            super().look()

    def stop(self, *, is_slow: bool = False) -> None:
        """End the daemon, once everybody has heard of all events."""
        with suppress(AssertionError):
            wait_for(lambda: not self.untold(), 20)
        super().stop(is_slow=is_slow)

    def revive(self) -> None:
        """Start it again where it is well."""
        self._heal()
        self.start()

    def missing(self) -> set[tuple[str, str]]:
        """Return what nobody heard of, or the store lacks although it was whole all the time."""
        if self._is_damaged:
            return self.untold()
        with suppress(DatabaseError):
            return super().missing()
        return {("store", "unreadable")}

    def _fail(self, kind: str) -> str:
        """Let something happen; return what is to be known of it."""
        if kind in _MODES:
            self._set(_MODES[kind])
        elif kind == "corrupt":
            return self._corrupt()
        else:
            left = 0 if kind == "full" else self.rng.randint(20_000, 2_000_000)
            with suppress(OSError), (self.disk / "filler").open("wb", buffering=0) as file:
                while (free := shutil.disk_usage(self.disk).free) > left:
                    file.write(bytes(min(65_536, max(1, free - left))))
        return kind

    def _heal(self) -> None:
        """Let it be well."""
        self._set(b"-")
        (self.disk / "filler").unlink(missing_ok=True)

    def _set(self, mode: bytes) -> None:
        # In place: the layer has the file mapped.
        with self._mode.open("r+b") as file:
            file.write(mode)

    def _corrupt(self) -> str:
        """Overwrite some pages of one file; return its name."""
        files = (p for p in self.disk.rglob("*") if p.suffix in {".db", ".db-wal", ".h5"})
        path = self.rng.choice(sorted(p for p in files if p.stat().st_size))
        with suppress(FileNotFoundError), path.open("r+b") as file:
            times = os.fstat(file.fileno())
            for _ in range(self.rng.randint(1, 4)):
                file.seek(4096 * self.rng.randrange(1 + path.stat().st_size // 4096))
                file.write(self.rng.randbytes(self.rng.randint(1, 4096)))
            # A disk that goes bad dates nothing: clips go by their dates.
            file.flush()
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        return f"corrupt {path.name}"

    def _is_well(self) -> bool:
        """Return whether only what lasts is said: a recording that ended, a file put aside."""
        reason = str(self.daemon.status().get("reason", "memory only"))
        return "memory only" not in reason and "cannot keep" not in reason


if __name__ == "__main__":
    sys.exit(campaign(__doc__, "faults", Guard))
