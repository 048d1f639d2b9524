"""The event log against a plain list, whatever happens in between, in any order.

What is delivered is exactly what was put, in order, each at least once, none skipped: over
refusals, kills, restarts, disks that are full, files that are damaged or taken away, and a clock
that is set.
"""

import errno
import os
import shutil
import sqlite3
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path
from unittest.mock import patch

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from radard import log as log_module
from radard.log import EventLog
from radard.log_file import open_log_file
from tests.machine_helpers import machine_settings
from tests.sink_helpers import event, ulid
from tests.waiting import wait_for

MOST = 20  # events that the log holds
MEMORY = Path("/dev/shm")  # noqa: S108 - a disk would be all that is measured
CURSORS = {"all": ("alarm", "fault"), "alarms": ("alarm",)}
PAGES = st.integers(0, 63)
NAMES = st.sampled_from(sorted(CURSORS))


class Disk:
    """A connection to a file whose disk may be full."""

    is_full = False

    def __init__(self, path, *more):
        self._refuse()
        self._db = open_log_file(path, *more)

    def _refuse(self):
        if Disk.is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def execute(self, statement, *values):
        if not statement.startswith("SELECT"):
            self._refuse()
        return self._db.execute(statement, *values)

    def executemany(self, statement, rows):
        self._refuse()
        return self._db.executemany(statement, rows)

    def close(self):
        self._db.close()


class LogMachine(RuleBasedStateMachine):
    """Events are numbers 1, 2, 3...; the model knows what became of each."""

    @initialize()
    def begin(self):
        Disk.is_full = False
        self._patches = ExitStack()
        self._patches.enter_context(patch("radard.log_file.open_log_file", Disk))
        for name, value in (("_CHECK_S", 0.0), ("_WAIT_S", 5.0)):
            self._patches.enter_context(patch.object(log_module, name, value))
        where = MEMORY if MEMORY.is_dir() else None
        self.folder = Path(tempfile.mkdtemp(prefix="log", dir=where))
        self.path = self.folder / "0.db"
        self.n_put = self.n_files = 0
        self.kinds = {}
        self.keys = {}
        self.settled = {name: set() for name in CURSORS}  # delivered, given up, may be lost
        self.deferred = {name: set() for name in CURSORS}
        self.may_repeat = False
        self.open()

    def open(self):
        self.log = EventLog(self.path, max_events=MOST)
        self.cursors = {
            name: self.log.cursor(name, lambda record, kinds=kinds: record["kind"] in kinds)
            for name, kinds in CURSORS.items()
        }

    def owed(self, name):
        """What the output has still to get, in order; those that went to the end are anywhere."""
        newest = range(max(1, self.n_put - MOST + 1), self.n_put + 1)
        wanted = [n for n in newest if self.kinds[n] in CURSORS[name]]
        return [n for n in wanted if n not in self.settled[name]]

    def next_of(self, name):
        """The entry that is next, checked against the model."""
        entry, owed = self.cursors[name].first(), self.owed(name)
        if entry is None:
            assert owed == [], f"{name} is owed {owed}"
            return None, 0
        n = int(entry.record["id"])
        assert self.keys.setdefault(n, entry.key) == entry.key
        in_order = [each for each in owed if each not in self.deferred[name]]
        is_repeat = n in self.settled[name] and self.may_repeat
        assert is_repeat or n in self.deferred[name] or n == in_order[0], (n, owed)
        return entry, n

    @rule(kind=st.sampled_from(["alarm", "fault"]))
    def put(self, kind):
        self.n_put += 1
        self.kinds[self.n_put] = kind
        self.log.append(event(self.n_put, kind=kind))

    @rule(name=NAMES)
    def deliver(self, name):
        entry, n = self.next_of(name)
        if entry is not None:
            self.cursors[name].done(entry)
            self.settled[name].add(n)

    @rule(name=NAMES)
    def refuse(self, name):
        entry, n = self.next_of(name)
        if entry is not None:
            self.cursors[name].defer(entry)
            self.deferred[name].add(n)

    @rule()
    def restart(self):
        self.log.close()
        self.lose_what_memory_holds()
        self.open()

    @rule()
    def kill(self):
        """Only what the file holds goes on; the process of before writes no more into it."""
        self.n_files += 1
        before, self.path = self.path, self.folder / f"{self.n_files}.db"
        if before.exists():
            try:
                new = sqlite3.connect(self.path)
                with closing(sqlite3.connect(before)) as old, closing(new):
                    old.backup(new)
            except sqlite3.DatabaseError:
                # Damage that nothing has read yet.
                shutil.copy(before, self.path)
                self.forgive()
        self.lose_what_memory_holds()
        self.log.close()
        self.may_repeat = True
        self.open()

    def lose_what_memory_holds(self):
        """A run that ends while no disk takes anything may lose events, and has said so."""
        if Disk.is_full:
            assert "in memory only" in self.log.fault or not any(map(self.owed, CURSORS))
            self.forgive()

    def forgive(self):
        for name in CURSORS:
            self.settled[name] |= set(self.owed(name))
        self.may_repeat = True

    @rule()
    def fill(self):
        Disk.is_full = True
        self.log.keep("word", "of a moment")
        self.log.keep("word", "of another")

    @precondition(lambda _: Disk.is_full)
    @rule()
    def make_room(self):
        Disk.is_full = False
        self.log.keep("word", "one")
        self.log.keep("word", "two")
        assert "in memory only" not in self.log.fault

    @rule(where=PAGES)
    def damage(self, where):
        """Pages turn to nonsense while the log is at work; it knows them by heart."""
        if self.path.exists() and not Disk.is_full:
            self.spoil(where)
            for word in ("is", "was"):
                self.log.keep("word", word)

    @rule(where=PAGES)
    def damage_while_nothing_runs(self, where):
        self.log.close()
        if self.path.exists() and self.spoil(where):
            # What could not be read is lost: with a word, and the file is there to be looked at.
            self.forgive()
        else:
            self.lose_what_memory_holds()
        self.open()

    def spoil(self, where):
        content = bytearray(self.path.read_bytes())
        pages = len(content) // 4096
        if not pages:
            return False
        page = where % pages
        content[page * 4096 : (page + 1) * 4096] = b"\xa5" * 4096
        with self.path.open("r+b") as file:
            file.write(content)
        return True

    @precondition(lambda _: not Disk.is_full)
    @rule()
    def take_away(self):
        """Somebody deletes the file under a log that is at work."""
        for each in self.folder.glob(f"{self.path.name}*"):
            each.unlink(missing_ok=True)  # the log may close one just now
        for word in ("gone", "back"):
            self.log.keep("word", word)
        wait_for(self.path.exists, 20.0)

    @rule(by_s=st.floats(-1e9, 1e9))
    def set_the_clock(self, by_s):
        real_s = time.time_ns() / 1e9
        self._patches.enter_context(patch.object(log_module.time, "time", lambda: real_s + by_s))

    def teardown(self):
        if not hasattr(self, "log"):
            return
        try:
            for name in CURSORS:
                for _ in range(3 * MOST):
                    self.deliver(name)
                assert self.owed(name) == []
            ids = [each.id for each in self.log.events()]
            assert ids == sorted(set(ids))
            assert set(ids) <= {ulid(n) for n in range(1, self.n_put + 1)}
            assert len(set(self.keys.values())) == len(self.keys)
        finally:
            self.log.close()
            self._patches.close()
            shutil.rmtree(self.folder)


TestLogMachine = LogMachine.TestCase
TestLogMachine.settings = machine_settings()
