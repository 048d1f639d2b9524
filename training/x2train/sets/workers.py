"""Workers: who makes the elements of a set - this process, local ones, or a Dask cluster.

A pool takes chunks and returns what was made of them in the same order. It keeps only a
few chunks ahead of the writer, so that a fast pool does not fill the memory.
"""

import importlib
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.synchronize import Event
from typing import Any, Protocol, TypeAlias

from numpy.typing import NDArray

from radard.errors import RadardError
from x2radar.interrupts import without_interrupts

Rows: TypeAlias = Mapping[str, NDArray[Any]]
Make: TypeAlias = Callable[[int], Rows | None]
Tell: TypeAlias = Callable[[int, int], None]  # is told how many are done, of how many
CHUNK = 8  # elements handed out at a time
_AHEAD = 4  # chunks per worker that are under way or wait for their turn to be written
_CONNECT_S = 30  # for a scheduler to answer, and for its first worker to start, in seconds
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class GenerateError(RadardError):
    """Workers cannot be reached, or died."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """Elements first to last - 1, all of one shard."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Made:
    """What a worker returns: the rows of its elements, or what went wrong with one."""

    rows: tuple[Rows, ...] = ()
    error: str = ""


Run: TypeAlias = Callable[[Make, Sequence[Chunk]], Iterator[Made]]
_Workers: TypeAlias = AbstractContextManager[Run]


def _make_chunk(make: Make, chunk: Chunk) -> Made:
    """Make the elements of a chunk: the whole work of a worker."""
    rows = []
    for number in range(chunk.first, chunk.last):
        if _Pooled.stop is not None and _Pooled.stop.is_set():
            return Made(error="stopped")
        try:
            made = make(number)
        except Exception as err:  # noqa: BLE001 - whatever it is, its element is named
            return Made(error=f"element {number}: {type(err).__name__}: {err}")
        if made:
            rows.append(dict(made))
    return Made(tuple(rows))


def workers_for(workers: int, cluster: str | None = None) -> _Workers:
    """Return a pool: of so many processes, of this one if that rounds alike, or of a cluster."""
    if cluster is not None:
        return _on_cluster(cluster)
    is_pinned = any(os.environ.get(name) == "1" for name in _THREADS[:2])
    return _in_process() if workers == 1 and is_pinned else pool(workers)


@contextmanager
def _in_process() -> Iterator[Run]:
    """Yield a pool that is this process."""

    def run(make: Make, chunks: Sequence[Chunk]) -> Iterator[Made]:
        return map(partial(_make_chunk, make), chunks)

    yield run


@contextmanager
def pool(workers: int) -> Iterator[Run]:
    """Yield a pool of local processes; GenerateError if one of them dies."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()

    def run(make: Make, chunks: Sequence[Chunk]) -> Iterator[Made]:
        def submit(chunk: Chunk) -> _Job:
            return executor.submit(_make_chunk, make, chunk)

        # Processes start at the first submit.
        with without_interrupts():
            return _in_order(submit, chunks, _AHEAD * workers)

    with (
        _one_thread(),
        ProcessPoolExecutor(
            workers, mp_context=context, initializer=_Pooled.enlist, initargs=(stop,)
        ) as executor,
    ):
        try:
            yield run
        except BrokenProcessPool as err:
            msg = "a worker process died (killed, or out of memory); run again to go on"
            raise GenerateError(msg) from err
        finally:
            stop.set()
            executor.shutdown(cancel_futures=True)


@contextmanager
def _on_cluster(address: str) -> Iterator[Run]:
    """Yield a pool of the workers of a Dask cluster; GenerateError if they are lost."""
    # Late: only those who ask for a cluster wait for the import.
    distributed: Any = importlib.import_module("distributed")
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as err:
        raise GenerateError(f"no Dask scheduler at {address}: {err}") from err

    def run(make: Make, chunks: Sequence[Chunk]) -> Iterator[Made]:
        threads = sum(client.nthreads().values())
        submit = partial(client.submit, _make_chunk, make, pure=False)
        return _in_order(submit, chunks, _AHEAD * max(threads, 1))

    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_S)
            yield run
        except TimeoutError as err:
            raise GenerateError(f"the Dask scheduler at {address} has no workers") from err
        except distributed.KilledWorker as err:
            msg = f"workers of the cluster died again and again on the same elements: {err}"
            raise GenerateError(msg) from err


class _Job(Protocol):
    def result(self) -> Made: ...


def _in_order(
    submit: Callable[[Chunk], _Job], chunks: Sequence[Chunk], ahead: int
) -> Iterator[Made]:
    waiting = iter(chunks)
    # Submitted now, not when the first result is asked for.
    jobs = deque(submit(chunk) for chunk in islice(waiting, ahead))

    def results() -> Iterator[Made]:
        while jobs:
            yield jobs.popleft().result()
            jobs.extend(submit(chunk) for chunk in islice(waiting, 1))

    return results()


class _Pooled:
    """What a worker process knows: whether to stop."""

    stop: Event | None = None

    @classmethod
    def enlist(cls, stop: Event) -> None:
        cls.stop = stop


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that start now have one thread for linear algebra, to round alike."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
