"""Tap: a recording that is made along the way (--record), or nothing."""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from radard.outputs.records import utc_now
from x2radar.frame import Frame, StreamInfo


class Tap:
    """Write every frame of a stream into a recording; without a path, do nothing."""

    def __init__(self, path: Path | None, stream: StreamInfo) -> None:
        self._close: Callable[[], None] = lambda: None
        self.write: Callable[[Frame], None] = lambda _frame: None
        if path is None:
            return
        # Late: a run that records nothing must not wait for h5py at start.
        from x2radar.recording.hdf5_writer import RecordingWriter  # noqa: PLC0415

        writer = RecordingWriter(
            path, stream, started_utc=utc_now(), device={"name": stream.device}, settings={}
        )
        self.write, self._close = writer.write, writer.close

    def __enter__(self) -> "Tap":
        """Return the tap."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording."""
        self._close()
