"""How a file is refused: one line, whatever is wrong with it."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from x2radar.errors import RecordingError, X2RadarError


def refuse(path: object, why: str) -> RecordingError:
    """Return the error that says in one line what is wrong with a file."""
    return RecordingError(f"{path}: {why}")


def refuse_taken(path: Path) -> None:
    """Raise RecordingError if there is something of this name."""
    if path.exists():
        raise refuse(path, "exists already; recordings are never overwritten")


@contextlib.contextmanager
def unreadable(path: object) -> Iterator[None]:
    """Turn what a damaged or hostile file makes of a reader into RecordingError, one line."""
    try:
        yield
    except (X2RadarError, NameError, AssertionError):
        raise
    except OSError as err:
        raise refuse(
            err.filename or path, f"cannot be read: {err.strerror or _one_line(err)}"
        ) from err
    except MemoryError as err:
        raise refuse(path, "asks for more memory than there is") from err
    except Exception as err:
        raise refuse(path, f"damaged ({type(err).__name__}: {_one_line(err)})") from err


def _one_line(err: BaseException) -> str:
    return " ".join(str(err).split())[:200]
