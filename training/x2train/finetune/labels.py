"""Own clips: which recordings people have labelled, on the dashboard or by hand.

The dashboard's lines are those of `radard.web.labels`; the last line of an event holds. By
hand, FILE=LABEL names any recording that `radard --port replay:` plays.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from radard.config.json_file import LOOSE, parse_json
from radard.errors import UsageError
from radard.web.labels import LABELS


@dataclass(frozen=True, slots=True)
class OwnClip:
    """A recording and what people say that it shows."""

    path: Path
    # human, pet, other, or wrong: an alarm that was for no human, whatever it was
    label: str

    @property
    def is_human(self) -> bool:
        """Whether the alarm was right."""
        return self.label == "human"


def named_clips(arguments: Iterable[str]) -> tuple[OwnClip, ...]:
    """Return the clips of arguments FILE=LABEL; raise UsageError on a wrong one."""
    clips = []
    for text in arguments:
        name, equals, label = text.rpartition("=")
        if not equals or not name or label not in LABELS:
            msg = f"'{text}': FILE=LABEL is wanted, with a label of {', '.join(LABELS)}"
            raise UsageError(msg)
        if not Path(name).is_file():
            raise UsageError(f"{name}: no such recording")
        clips.append(OwnClip(Path(name), label))
    return tuple(clips)


def labelled_clips(path: Path, folder: Path | None = None) -> tuple[list[OwnClip], list[str]]:
    """Return the clips of the dashboard's labels, in `folder`, and why others were left out."""
    events = _last_lines(path)
    clips, left_out = [], []
    for event, line in events.items():
        if line.kind != "alarm":
            left_out.append(f"{event}: labelled {line.label}, but not an alarm")
        elif not line.clip:
            left_out.append(f"{event}: no clip was kept of it")
        else:
            where = folder / Path(line.clip).name if folder else Path(line.clip)
            if where.is_file():
                clips.append(OwnClip(where, line.label))
            else:
                left_out.append(f"{event}: its clip is gone ({where})")
    return clips, left_out


def merged(clips: Iterable[OwnClip]) -> tuple[OwnClip, ...]:
    """Return clips, each once; UsageError if one has two labels, or all are of people."""
    by_path: dict[Path, OwnClip] = {}
    for clip in clips:
        known = by_path.setdefault(clip.path.resolve(), clip)
        if known.label != clip.label:
            raise UsageError(f"{clip.path}: labelled both {known.label} and {clip.label}")
    if all(clip.is_human for clip in by_path.values()):
        msg = "no clip is labelled pet, other or wrong: there is nothing to quieten; label one"
        raise UsageError(msg)
    return tuple(by_path.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """What is read of a line of the dashboard's labels."""

    __pydantic_config__ = LOOSE

    format: Literal["radard-label"]
    format_version: Literal[1]
    event: str
    label: Literal["human", "pet", "other", "wrong"]
    clip: str | None = None
    kind: str | None = None


def _last_lines(path: Path) -> Mapping[str, _Line]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as err:
        raise UsageError(f"{path}: cannot read the labels ({err})") from err
    events: dict[str, _Line] = {}
    for number, row in enumerate(text.splitlines(), 1):
        try:
            line = parse_json(_Line, row)
        except ValueError as err:
            msg = f"{path}:{number}: no label of the dashboard ({err}); take this line out"
            raise UsageError(msg) from err
        events[line.event] = line
    return events
