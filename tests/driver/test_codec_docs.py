"""What docstrings call inferred or unknown stands in docs/research/hardware.md; nothing else."""

import re
from pathlib import Path

from x2radar.wire import messages, messages_expert, messages_status, messages_x4
from x2radar.wire.layouts import COMMAND_VARIANTS, COMMANDS, RESPONSE_VARIANTS, RESPONSES

DOCS = Path(__file__).parents[2] / "docs"
ROWS = COMMANDS + COMMAND_VARIANTS + RESPONSES + RESPONSE_VARIANTS


def test_every_reading_of_ours_is_listed() -> None:
    doubtful = {
        name
        for module in (messages, messages_expert, messages_status, messages_x4)
        for name, cls in vars(module).items()
        if isinstance(cls, type)
        and cls.__module__ == module.__name__
        and re.search(r"inferred|unknown|not seen|known for", cls.__doc__ or "")
    } - {"Unknown"}
    page = (DOCS / "research" / "hardware.md").read_text("utf-8")
    section = page.split("## Readings of ours")[1]
    listed = set(re.findall(r"`([A-Z][A-Za-z0-9]+)`", section))
    assert doubtful - listed == set()
    known = {row.cls.__name__ for row in ROWS} | {"Data", "DataText", "SetOutput"}
    assert {name for name in listed if name in known} == doubtful


def test_the_reference_names_what_no_row_describes() -> None:
    """The rows themselves are checked on the built page, in test_site.py."""
    text = (DOCS / "reference" / "protocol.md").read_text("utf-8")
    for name in ("SetOutput", "Reply", "ByteReply", "Data", "DataText", "Unknown"):
        assert f"`{name}`" in text


def test_messages_with_a_source_of_their_own_are_there() -> None:
    text = (DOCS / "reference" / "protocol.md").read_text("utf-8")
    listed = re.findall(
        r"`([A-Z]\w+)`", " ".join(re.findall(r"^Sources: `.*?\.$", text, re.MULTILINE | re.DOTALL))
    )
    assert len(listed) > 30
    assert set(listed) <= {row.cls.__name__ for row in ROWS}
