"""Wire captures as recordings: the frames that the driver would have had.

The module's bytes go through the driver's decoder and assembler once to be counted and once
to be read, so a capture needs no memory of its size. Raw RF frames carry no axis; it follows
from the settings in the capture's head. Read only. Damaged packets are named in the warning.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import numpy as np

from x2radar.device.assemble import FrameAssembler
from x2radar.errors import MessageError, SettingsError
from x2radar.frame import Frame, Samples
from x2radar.modules.modules import settings_from_mapping
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader
from x2radar.recording.capture import FROM_MODULE, OPENED, TO_MODULE, Capture, Chunk
from x2radar.recording.faults import refuse
from x2radar.wire.codec import decode_command
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.messages import SetMode, X4Set
from x2radar.wire.protocol import Damaged, Received, Session
from x2radar.wire.wire_ids import Mode, X4Setting


class Reader(BlockReader):
    """Read the frames of a capture."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        self._capture = Capture(path)
        about = self._capture.about
        said = about.get("settings")
        warnings = []
        try:
            self._module = settings_from_mapping(dict(said or {}))
        except (SettingsError, TypeError, ValueError) as err:
            # Of another version: as far as this one knows them.
            self._module = RadarSettings()
            warnings.append(f"{path}: settings that are not known ({err}); an X2's are assumed")
        self._n_damaged = 0
        host = PacketDecoder()
        # Where the host starts a stream, what came before is not its own.
        self._is_started = any(_starts(host, chunk) for chunk in self._capture.chunks())
        counters: list[int] = []
        first: Frame | None = None
        for frame in self._decoded():
            first = first or frame
            if frame.axis.n_range != first.axis.n_range or frame.axis.kind != first.axis.kind:
                raise refuse(path, "its frames change their shape on the way")
            counters.append(frame.counter)
        if first is None:
            raise refuse(path, "no frames in it")
        self._counter = np.array(counters, np.uint32)
        self.n_frames = len(counters)
        known = {"frame_rate_hz": self._module.frame_rate_hz, **asdict(first.axis)}
        known |= {"started_utc": about.get("started_utc"), "settings": said}
        device = str(about.get("port") or path.name)
        self._keep((first.axis.kind, first.axis.n_range), known, device)
        warnings += [self._capture.warning] if self._capture.warning else []
        if self._n_damaged:
            warnings.append(f"{path}: {self._n_damaged} damaged stretches")
        self.warning = "; ".join(warnings) or None
        self._at = -1
        self._rest: Iterator[Frame] = iter(())

    def read_samples(self, first: int, last: int) -> Samples:
        # Block after block is one pass.
        if self._at < 0 or first < self._at:
            self._rest, self._at = self._decoded(), 0
        wanted = list(islice(self._rest, first - self._at, last - self._at))
        self._at = last
        return self._falling(np.stack([f.samples for f in wanted]))

    def _decoded(self) -> Iterator[Frame]:
        session, host = Session(), PacketDecoder()
        assembler = None if self._is_started else FrameAssembler(self._module)
        self._n_damaged = 0
        for chunk in self._capture.chunks():
            if assembler is None and _starts(host, chunk):
                assembler = FrameAssembler(self._module)
            if chunk.kind == OPENED:
                session = Session()
            if chunk.kind != FROM_MODULE:
                continue
            session.receive(chunk.data)
            while (event := session.next_event()) is not None:
                if isinstance(event, Damaged):
                    self._n_damaged += 1
                elif isinstance(event, Received) and assembler is not None:
                    frame = assembler.frame(event.message, chunk.t_s)
                    if frame is not None:
                        yield frame


def _starts(host: PacketDecoder, chunk: Chunk) -> bool:
    """Return whether the host's bytes in `chunk` end a command that starts a stream."""
    for item in host.feed(chunk.data) if chunk.kind == TO_MODULE else ():
        with contextlib.suppress(MessageError):
            match decode_command(item.data) if isinstance(item, Packet) else None:
                case SetMode(Mode.RUN | Mode.MANUAL):
                    return True
                case X4Set(X4Setting.FPS, (rate_hz,)) if rate_hz > 0:
                    return True
    return False
