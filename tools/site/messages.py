"""Tables of the protocol's messages, made from the rows of `x2radar.wire.messages`."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from enum import IntEnum

from x2radar.wire import wire_ids
from x2radar.wire.messages import COMMANDS, RESPONSES, X4_FORMATS, Layout
from x2radar.wire.wire_ids import COMMAND_NAMES, RESPONSE_NAMES, X4Setting

_TYPES = {"B": "u8", "I": "u32", "i": "i32", "f": "f32"}


def _table(rows: Iterable[Layout], *, is_answered: bool = False) -> str:
    head = ["class", "begins with", "then", *(["answer"] if is_answered else [])]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in rows:
        cells = [f"`{row.cls.__name__}`", f"`{row.prefix.hex(' ')}`", ", ".join(_parts(row))]
        if is_answered:
            cells.append(row.answer.__name__.upper() if row.answer else "")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _parts(row: Layout) -> Iterator[str]:
    names = iter([each.name for each in fields(row.cls)])
    if not row.head:
        yield "none"
    for place, code in enumerate(row.head):
        yield f"{_TYPES[code]} {'n' if place == row.count else next(names)}"
    for _ in range(row.n_arrays):
        yield f"f32 {next(names)}[n]"
    if row.has_rest:
        yield "anything"


def _names(names: Mapping[bytes, str]) -> str:
    lines = ["| name | begins with |", "|---|---|"]
    lines += [f"| {name} | `{prefix.hex(' ')}` |" for prefix, name in names.items()]
    return "\n".join(lines)


def _numbers() -> str:
    kinds = [kind for kind in vars(wire_ids).values() if isinstance(kind, type)]
    lines = ["| enumeration | hexadecimal number and name |", "|---|---|"]
    lines += [
        f"| `{kind.__name__}` | {', '.join(f'{x:X} {x.name}' for x in kind)} |"
        for kind in kinds
        if issubclass(kind, IntEnum) and kind is not IntEnum
    ]
    return "\n".join(lines)


def _x4_settings() -> str:
    lines = ["| setting | begins with | then |", "|---|---|---|"]
    for setting, forms in X4_FORMATS.items():
        types = " or ".join(", ".join(_TYPES[code] for code in form) for form in forms)
        lines.append(f"| {X4Setting(setting).name} | `50 10 {setting:02x} 00 00 00` | {types} |")
    return "\n".join(lines)


def _by_first_byte(rows: Iterable[Layout], first: set[int]) -> list[Layout]:
    return [row for row in rows if row.prefix[0] in first]


_OWN = {0x10, 0x90, 0x50}  # first bytes of commands that have a section each
PARTS: Mapping[str, Callable[[], str]] = {
    "commands": lambda: _table(
        [row for row in COMMANDS if row.prefix[0] not in _OWN], is_answered=True
    ),
    "commands-profiles": lambda: _table(_by_first_byte(COMMANDS, {0x10}), is_answered=True),
    "commands-system": lambda: _table(_by_first_byte(COMMANDS, {0x90}), is_answered=True),
    "commands-x4": lambda: _table(_by_first_byte(COMMANDS, {0x50}), is_answered=True),
    "commands-x4-settings": _x4_settings,
    "commands-names": lambda: _names(COMMAND_NAMES),
    "numbers": _numbers,
    "answers": lambda: _table([row for row in RESPONSES if row.prefix[0] != 0x50]),
    "answers-profiles": lambda: _table(_by_first_byte(RESPONSES, {0x50})),
    "answers-names": lambda: _names(RESPONSE_NAMES),
}
"""What a line `<!-- generated: NAME -->` of docs/reference/protocol.md stands for."""
