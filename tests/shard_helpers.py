"""Elements for the farm's tests: importable, so that other processes can make them."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from x2train.sets.workers import _Pooled


@dataclass(frozen=True)
class Draws:
    """Element k: k % 3 rows of draws seeded with k; some none at all.

    It may fail, kill its process, wait for the end (`waits_at`), or wait until so many
    processes make elements (`meets`).
    """

    seed: int = 1
    meets: int = 0
    fails_at: int = -1
    dies_at: int = -1
    killed_once_at: int = -1
    waits_at: int = -1
    log: Path | None = None

    def __call__(self, number):
        if self.log is not None:
            with self.log.open("a") as file:
                file.write(f"{number} {os.getpid()}\n")
        if number == self.waits_at:
            _Pooled.stop.wait(60)
        for _ in range(6000):
            if not self.meets or len(self.made()[1]) >= self.meets:
                break
            time.sleep(0.01)
        if number == self.killed_once_at and self.made()[0].count(number) == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if number == self.fails_at:
            raise ValueError("bad draw")
        if number == self.dies_at:
            os._exit(1)
        if number % 5 == 4:
            return None
        rng = np.random.default_rng([self.seed, number])
        rows = number % 3
        matrix = rng.standard_normal((40, 40)).astype(np.float32)
        names = {"name": np.array([f"element {number}"]), "n": np.array([rows])}
        return {"x": (matrix @ matrix)[:rows], **names}

    def made(self):
        """Return the elements that were begun, in order, and the processes."""
        rows = [line.split() for line in self.log.read_text().splitlines()]
        return [int(number) for number, _ in rows], {int(pid) for _, pid in rows}
