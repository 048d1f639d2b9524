"""The subcommands of `x2radar`: one file each, with `register(commands)`."""

import argparse
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


def check_duration(duration_s: float | None) -> None:
    """Raise SettingsError unless a --duration is above zero."""
    if duration_s is not None and not 0 < duration_s < 1e9:
        msg = f"--duration {duration_s:g}: must be above 0, in seconds"
        raise SettingsError(msg)
