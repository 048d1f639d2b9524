"""`radard diag`: write a support bundle without secrets.

Every part is gathered by itself: what fails says so in its own file and stops no other.
"""

import io
import json
import tarfile
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from radard.commands.diag_parts import Scrubber, gather
from radard.errors import RadardError
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard diag                     radard-diag-TIME.tar.gz, in this folder
  radard diag --config /etc/radard/config.yaml --out /tmp/report.tar.gz
  radard diag --add clips/01JD.h5 a recording goes along only if named
  radard diag --list              what would be in it
"""
_ABOUT = """\
A report by radard diag, {when}.

Left out: passwords, tokens, keys, the arguments of programs and paths of webhooks, serial
numbers, the name of the user's folder. No frames and no clips, unless they were added by name.
Look through it before you send it on.

"""
_MAX_ADDED_BYTES = 500e6  # all clips that a daemon keeps


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
    args = make_parser().parse_args(argv)
    when = datetime.now(UTC)
    parts = gather(args.config)
    if args.list:
        for name, text in parts.items():
            print(f"==== {name}\n{text.rstrip()}\n")
        return 0
    path = args.out or Path(f"radard-diag-{when:%Y%m%dT%H%M%SZ}.tar.gz")
    write_bundle(path, {"README.txt": _readme(when, parts, args.add), **parts}, args.add)
    print(path)
    return 0


def make_parser() -> Parser:
    """Return the parser of the subcommand."""
    parser = new_parser("radard diag", "Make one redacted file to report trouble with.", _EXAMPLES)
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--out", type=Path, metavar="FILE", help="file to make (radard-diag-TIME.tar.gz)")
    add("--add", type=Path, action="append", default=[], metavar="FILE", help="a recording")
    add("--list", action="store_true", help="print the parts instead of making a file")
    return parser


def write_bundle(path: Path, parts: Mapping[str, str], added: Sequence[Path]) -> None:
    """Write parts by name and, as they are, the files that were added; `path` must not exist.

    Raises RadardError if a file is not to be had, is too large, or the bundle cannot be written.
    """
    try:
        total = sum(file.stat().st_size for file in added)
        if total > _MAX_ADDED_BYTES:
            msg = f"--add: {total / 1e6:.0f} MB are too much; 500 MB fit"
            raise RadardError(msg)
        with path.open("xb") as out, tarfile.open(fileobj=out, mode="w:gz") as tar:
            # Private: what is redacted is still about somebody's home.
            path.chmod(0o600)
            for name, text in parts.items():
                data = text.encode()
                about = tarfile.TarInfo(f"radard-diag/{name}")
                about.size, about.mtime = len(data), int(time.time())
                tar.addfile(about, io.BytesIO(data))
            for file in added:
                about = tarfile.TarInfo(f"radard-diag/added/{file.name}")
                about.size, about.mtime = file.stat().st_size, int(file.stat().st_mtime)
                with file.open("rb") as content:
                    tar.addfile(about, content)
    except FileExistsError as err:
        msg = f"{path}: exists already; reports are never overwritten"
        raise RadardError(msg) from err
    except OSError as err:
        msg = f"{err.filename or path}: {err.strerror or err}"
        raise RadardError(msg) from err


def _readme(when: datetime, parts: Mapping[str, str], added: Sequence[Path]) -> str:
    names = [*parts, *(f"added/{file.name}" for file in added)]
    about = _ABOUT.format(when=when.isoformat(timespec="seconds"))
    return Scrubber(()).scrub(about + json.dumps(names, indent=1) + "\n")
