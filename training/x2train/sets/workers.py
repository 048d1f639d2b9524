"""Workers: who makes the elements of a set - this process, local ones, or a Dask cluster.

Chunks of elements come back in the order in which they are asked for. Only a few are under way
ahead of the writer, so that a fast pool does not fill the memory.
"""

import importlib
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.synchronize import Event
from typing import Any, TypeAlias

from numpy.typing import NDArray

from radard.errors import RadardError
from x2radar.interrupts import without_interrupts

Rows: TypeAlias = Mapping[str, NDArray[Any]]
Make: TypeAlias = Callable[[int], Rows | None]
Tell: TypeAlias = Callable[[int, int], None]  # is told how many are done, of how many
Run: TypeAlias = Callable[[Make, Iterable[range]], Iterator[list[Rows]]]
_Result: TypeAlias = Callable[[], list[Rows]]
CHUNK = 8  # elements handed out at a time
_AHEAD = 4  # chunks per worker that are under way or wait for their turn to be written
_CONNECT_S = 30  # for a scheduler to answer, and for its first worker to start, in seconds
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Crew:
    """Who makes a set, and who is told of it."""

    workers: int = 1  # local processes
    cluster: str | None = None  # address of a Dask scheduler, whose workers are taken instead
    report: Tell = lambda _done, _total: None  # told after every chunk


ALONE = Crew()


def _make_chunk(make: Make, chunk: range) -> list[Rows]:
    """Return the rows of the elements of a chunk: the whole work of a worker."""
    rows: list[Rows] = []
    for number in chunk:
        if _Pooled.stop is not None and _Pooled.stop.is_set():
            break
        try:
            made = make(number)
        except Exception as err:
            raise RadardError(f"element {number}: {type(err).__name__}: {err}") from err
        if made:
            rows.append(dict(made))
    return rows


def workers_for(crew: Crew, n_chunks: int) -> AbstractContextManager[Run]:
    """Return a pool: of so many processes, of this one if that rounds alike, or of a cluster."""
    if crew.cluster is not None:
        return _on_cluster(crew.cluster)
    workers = min(crew.workers, n_chunks)
    is_pinned = any(os.environ.get(name) == "1" for name in _THREADS[:2])
    if workers == 1 and is_pinned:
        return nullcontext(lambda make, chunks: map(partial(_make_chunk, make), chunks))
    return pool(workers)


@contextmanager
def pool(workers: int) -> Iterator[Run]:
    """Yield a pool of local processes; RadardError if one of them dies."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()

    def submit(make: Make, chunk: range) -> _Result:
        # Processes start as chunks come.
        with without_interrupts():
            return executor.submit(_make_chunk, make, chunk).result

    initargs = (_Pooled, "stop", stop)
    with (
        _one_thread(),
        ProcessPoolExecutor(
            workers, mp_context=context, initializer=setattr, initargs=initargs
        ) as executor,
    ):
        try:
            yield lambda make, chunks: _in_order(partial(submit, make), chunks, _AHEAD * workers)
        except BrokenProcessPool as err:
            msg = "a worker process died (killed, or out of memory); run again to go on"
            raise RadardError(msg) from err
        finally:
            stop.set()
            executor.shutdown(cancel_futures=True)


@contextmanager
def _on_cluster(address: str) -> Iterator[Run]:
    """Yield a pool of the workers of a Dask cluster; RadardError if they are lost."""
    # Late: only those who ask for a cluster wait for the import.
    distributed: Any = importlib.import_module("distributed")
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as err:
        raise RadardError(f"no Dask scheduler at {address}: {err}") from err

    def submit(make: Make, chunk: range) -> _Result:
        result: _Result = client.submit(_make_chunk, make, chunk, pure=False).result
        return result

    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_S)
            ahead = _AHEAD * max(sum(client.nthreads().values()), 1)
            yield lambda make, chunks: _in_order(partial(submit, make), chunks, ahead)
        except TimeoutError as err:
            raise RadardError(f"the Dask scheduler at {address} has no workers") from err
        except distributed.KilledWorker as err:
            msg = f"workers of the cluster died again and again on the same elements: {err}"
            raise RadardError(msg) from err


def _in_order(
    submit: Callable[[range], _Result], chunks: Iterable[range], ahead: int
) -> Iterator[list[Rows]]:
    waiting = iter(chunks)
    jobs = deque(map(submit, islice(waiting, ahead)))
    while jobs:
        yield jobs.popleft()()
        jobs.extend(map(submit, islice(waiting, 1)))


class _Pooled:
    """What a worker process knows: whether to stop."""

    stop: Event | None = None


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that start now have one thread for linear algebra, to round alike."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        # A training that follows in this process has all threads.
        for name, value in before.items():
            del os.environ[name]
            os.environ |= {} if value is None else {name: value}
