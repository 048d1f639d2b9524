"""Decisions as rows of a CSV file."""

import csv
from pathlib import Path

from radard.config.sink_table import SinkOptions
from radard.errors import OutputError
from radard.outputs.base import DeliveryError, Record, Sink, SinkContext
from radard.outputs.thread_sink import DirectSink
from x2radar.backoff import Backoff

COLUMNS = ("time", "t_s", "gate", "label", "alarm", "range_m")


class CsvSink(DirectSink):
    """Appends a row for every decision."""

    def __init__(self, path: Path, context: SinkContext) -> None:
        backoff = Backoff(1.0, 30.0, context.sensor)
        super().__init__(f"csv:{path}", backoff, context)
        try:
            self._file = path.open("a", newline="", encoding="utf-8")
        except OSError as err:
            msg = f"-o csv:{path}: {err.strerror}"
            raise OutputError(msg) from err
        self._rows = csv.writer(self._file)

    def _deliver(self, record: Record) -> None:
        if record["type"] != "decision":
            return
        try:
            self._rows.writerow([record[name] for name in COLUMNS])
            self._file.flush()
        except OSError as err:
            raise DeliveryError(err.strerror or str(err)) from err

    def _shut(self) -> None:
        self._file.close()


def open_csv(url: str, options: SinkOptions, context: SinkContext) -> Sink:
    """Open csv:FILE."""
    sink = CsvSink(Path(url.partition(":")[2]), context)
    sink.start()
    return sink
