"""The subcommands of `x2radar`: one file each, with `register(commands)`."""

import argparse
import math
from typing import TypeAlias

from x2radar.errors import SettingsError

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_command(
    commands: Commands, name: str, text: str, examples: str
) -> argparse.ArgumentParser:
    """Add a subcommand; `text` says what it does, `examples` end its help."""
    return commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def parse_speed(text: str) -> float | None:
    """Return scene seconds per real second; None is as fast as possible.

    Raises SettingsError unless `text` is realtime, max or a number above zero.
    """
    if text in {"realtime", "max"}:
        return 1.0 if text == "realtime" else None
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 0 < factor < 1e6:
        msg = f"--speed '{text}': use realtime, max or a factor above 0"
        raise SettingsError(msg)
    return factor


def check_duration(duration_s: float | None) -> None:
    """Raise SettingsError unless a --duration is above zero."""
    if duration_s is not None and not 0 < duration_s < 1e9:
        msg = f"--duration {duration_s:g}: must be above 0, in seconds"
        raise SettingsError(msg)
