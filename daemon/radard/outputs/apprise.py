"""Apprise: events as messages to people, by one of its hundred services; with the alarm's picture.

`apprise:URL` is an Apprise URL, `apprise:@FILE` a file whose first line is one. Those are secrets,
so nothing that Apprise logs is handed on. https://github.com/caronc/apprise/wiki
"""

import contextlib
import logging
import re
import time
from pathlib import Path
from typing import Any

from radard.config.credentials import read_secret
from radard.config.sink_table import AppriseSection, SinkOptions
from radard.errors import UsageError
from radard.log import Entry
from radard.log_file import marks_of
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.thread_sink import Delivery, picture_path, wants_events
from x2radar.extras import needed

_PICTURE_S = 3.0  # drawing takes a tenth of that, and the alarm waits for it
_LOOK_S = 0.1
_SCHEME = re.compile(r"([a-z][a-z0-9+.-]*)://", re.IGNORECASE)
_STATUS = re.compile(r"error=(\d{3})\b")
_REFUSALS = frozenset({"400", "401", "403", "404", "405", "410", "413", "415", "422"})
"""About this message or this URL (RFC 9110): it is tried only so often."""
_KINDS = {"alarm": "failure", "tamper": "warning", "fault": "warning"}
"""Apprise's type of a message when an event begins or changes; its end is a success."""


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> Delivery:
    """Return the sink of `apprise:URL` or `apprise:@FILE`; MissingExtra without Apprise."""
    target = url.partition(":")[2]
    if target.startswith("@"):
        target = read_secret("apprise.url", Path(target[1:]), None) or ""
    apprise, scheme = needed("apprise", what="--output apprise"), _SCHEME.match(target)
    # Its lines, and those of the HTTP library, may hold tokens.
    own_log = logging.getLogger("apprise")
    own_log.propagate = False
    own_log.addHandler(logging.NullHandler())
    logging.getLogger("urllib3").setLevel(logging.ERROR)
    service = scheme and _service(apprise, target)
    if scheme is None or service is None:
        raise UsageError(
            "--output apprise: no URL that Apprise knows; give apprise:SERVICE://... or "
            "apprise:@FILE with such a URL in its first line"
        )
    o, sensor = options.apprise, context.sensor

    def send(entry: Entry) -> None:
        """Send an event to the service; what Apprise logs may hold secrets."""
        record = entry.record
        title, body = message_of(record, sensor)
        picture = _picture(record, o)
        with apprise.LogCapture(level=logging.WARNING) as said:
            is_taken = service.notify(
                title=title,
                body=body,
                notify_type="success" if record["phase"] == "end" else _KINDS[record["kind"]],
                attach=apprise.AppriseAttachment(str(picture)) if picture else None,
            )
            status = _STATUS.search(said.getvalue())
        if not is_taken:
            why = f"answers {status[1]}" if status else "was not reached, or refuses"
            msg = f"the service {why}"
            raise DeliveryError(msg, is_refusal=bool(status and status[1] in _REFUSALS))

    name, wants = f"apprise:{scheme[1].lower()}", wants_events(o.kinds, o.phases)
    return Delivery(name, target, options.log, context, wants, send)


def _service(apprise: Any, url: str) -> Any:
    """Return the service of a URL, None if there is none."""
    asset = apprise.AppriseAsset(
        app_id="radard",
        app_desc="radard",
        async_mode=False,
        # No file of its own, and no others of the user's.
        storage_mode=apprise.PersistentStoreMode.MEMORY,
        plugin_paths=[],
    )
    return apprise.Apprise.instantiate(url, asset=asset, suppress_exceptions=True)


def message_of(record: Record, sensor: str) -> tuple[str, str]:
    """Return title and text, for people, of an event."""
    what = record["kind"] if record["phase"] == "new" else f"{record['kind']} {record['phase']}"
    head = f"{record.get('sensor', sensor)}: {what}"
    return f"{head}{marks_of(record)}", f"{record['reason']}\n{record['time']}"


def _picture(record: Record, options: AppriseSection) -> Path | None:
    """Return an alarm's picture, once it is drawn; None if there is or will be none."""
    path = picture_path(record) if options.picture and record["phase"] != "update" else None
    end_s = time.monotonic() + _PICTURE_S
    with contextlib.suppress(OSError):
        while path is not None and time.monotonic() < end_s:
            if path.is_file():
                return path
            time.sleep(_LOOK_S)
    return None
