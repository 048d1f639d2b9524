"""Mutations of bytes: what a broken disk, a cut transfer and a malicious hand make of a file."""

import math
import random
import re
import struct
from collections.abc import Callable, Sequence

from x2radar.recording.hdf5_reader import lookup3

BORDER = b"\n--8<--\n"
"""Between the parts of an input."""
_NUMBERS = (0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFF)
_LONG = (1 << 40, (1 << 63) - 1, (1 << 64) - 1)
_WORDS = (
    *b'null true [] {} "" -1 0 1e999 -1e999 NaN 1e300 Infinity "\\ud800" "a" [[1]] ~ *a'.split(),
    *b"!!python/none 2001-02-30 1:2:3 1_0 .inf \xff \xed\xa0\x80".split(),
    *(b"<<: ", b"&a ", b"&a [*a]", b"? ", b"- ", b"\t", b"\x00", b"0x" + b"F" * 300),
    *(b"9" * 40, b"9" * 400, b"9" * 5000, b"[" * 3000, b'{"a":' * 3000),
)
"""Values that YAML, JSON and Python read in ways of their own, or that cost them much."""
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_TEXT = re.compile(rb'"[^"\n]{0,60}"|[A-Za-z_][A-Za-z0-9_]{2,}')


def mutate(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Return `data` with one to six changes; `others` lend parts."""
    out = bytearray(data or rng.choice(_WORDS))
    is_text = b"\0" not in data[:512]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        change = rng.choice(_TEXT_CHANGES if is_text and rng.random() < 0.8 else _CHANGES)
        if not (out := change(rng, out, others)):
            break
    if out[:8] == b"\x89HDF\r\n\x1a\n" and rng.random() < 0.6:
        _mend_checksums(out)
    return bytes(out)


def _flip(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    out[_place(rng, out)] ^= 1 << rng.randrange(8)
    return out


def _place(rng: random.Random, out: bytearray) -> int:
    # Heads are denser in meaning than what follows them.
    return rng.randrange(len(out) if rng.random() < 0.5 else min(len(out), 256))


def _number(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    width = rng.choice((1, 2, 4, 4, 8))
    value = rng.choice((*_NUMBERS, *_LONG, rng.getrandbits(32))) & ((1 << 8 * width) - 1)
    at = _place(rng, out)
    if rng.random() < 0.7:
        at -= at % min(width, 4)
    piece = value.to_bytes(width, rng.choice(("little", "big")))
    out[at : at + width] = piece[: len(out) - at]
    return out


def _float(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    value = rng.choice((float("nan"), float("inf"), -float("inf"), 0.0, -1.0, 1e300, 1e-320, 1e30))
    short = 3e38 if 3e38 < abs(value) < math.inf else value
    piece = struct.pack("<d", value) if rng.random() < 0.5 else struct.pack("<f", short)
    at = _place(rng, out)
    out[at : at + len(piece)] = piece[: len(out) - at]
    return out


def _cut(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    return out[: rng.randrange(len(out) + 1)]


def _drop(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    at = rng.randrange(len(out))
    del out[at : at + rng.choice((1, 2, 4, 8, 64, 1000))]
    return out


def _again(rng: random.Random, out: bytearray, others: Sequence[bytes]) -> bytearray:
    source = bytes(out) if rng.random() < 0.5 or not others else rng.choice(others)
    at, n = rng.randrange(len(source) or 1), rng.choice((1, 4, 8, 32, 256, 2000))
    place = rng.randrange(len(out))
    piece = source[at : at + n] * rng.choice((1, 1, 1, 20))
    out[place : place + (len(piece) if rng.random() < 0.5 else 0)] = piece
    return out


def _word(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    at = rng.randrange(len(out))
    out[at:at] = rng.choice(_WORDS)
    return out


def _token(rng: random.Random, out: bytearray, _others: Sequence[bytes]) -> bytearray:
    """Put a strange value, or another of the same text, where a number or a word stands."""
    found = list(rng.choice((_NUMBER, _TEXT)).finditer(bytes(out)))
    if not found:
        return out
    spot, other = rng.choice(found), rng.choice(found)
    out[spot.start() : spot.end()] = other.group() if rng.random() < 0.3 else rng.choice(_WORDS)
    return out


def _line(rng: random.Random, out: bytearray, others: Sequence[bytes]) -> bytearray:
    """Drop, repeat, move or indent a line, or take one of another file."""
    lines = bytes(out).split(b"\n")
    k = rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        del lines[k]
    elif kind == 1:
        lines[k:k] = [lines[k]] * rng.choice((1, 3))
    elif kind == 2:
        lines[k] = b"  " * rng.randrange(4) + lines[k].lstrip()
    else:
        lines.insert(k, rng.choice(rng.choice(others or [bytes(out)]).split(b"\n")))
    return bytearray(b"\n".join(lines))


_Change = Callable[[random.Random, bytearray, Sequence[bytes]], bytearray]
_CHANGES: tuple[_Change, ...] = (_flip, _flip, _number, _number, _float, _cut, _drop, _again)
_TEXT_CHANGES: tuple[_Change, ...] = (_token, _token, _token, _line, _word, _drop, _again, _cut)


def _mend_checksums(out: bytearray) -> None:
    """Give the superblock, object headers and chunk indices of an HDF5 file good checksums."""
    if len(out) > 48 and out[8] in {2, 3}:
        struct.pack_into("<I", out, 44, lookup3(bytes(out[:44])))
    for found in re.finditer(rb"OHDR\x02|EAHD\x00", bytes(out)):
        at = found.start()
        n = 68 if out[at : at + 1] == b"E" else _header_bytes(out, at)
        if n and at + n + 4 <= len(out):
            struct.pack_into("<I", out, at + n, lookup3(bytes(out[at : at + n])))


def _header_bytes(out: bytearray, at: int) -> int:
    """Return the bytes of an object header (version 2) before its checksum; 0 if cut off."""
    flags = out[at + 5] if at + 5 < len(out) else 0
    begin = at + 6 + 16 * bool(flags & 0x20) + 4 * bool(flags & 0x10)
    width = 1 << (flags & 3)
    if begin + width > len(out):
        return 0
    return begin + width + int.from_bytes(out[begin : begin + width], "little") - at
