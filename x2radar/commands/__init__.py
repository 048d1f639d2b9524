"""The subcommands of `x2radar`; each file has `register(commands)`."""

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


def check_above_zero(option: str, value: float | None, unit: str) -> None:
    """Raise SettingsError unless the value of an option is above zero, where it is given."""
    if value is not None and not 0 < value < 1e9:
        raise SettingsError(f"{option} {value:g}: must be above 0, in {unit}")
