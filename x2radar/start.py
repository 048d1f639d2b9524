"""Starts a command as a process."""

from importlib import import_module

from x2radar.startup import begin


def start(prog: str, module: str) -> int:
    """Run a command as a process; a signal while `module` is imported ends it at once."""
    begin()
    # Late: signals are heard before anything else is loaded.
    from x2radar.command import run_command  # noqa: PLC0415

    return run_command(prog, lambda argv: int(import_module(module).main(argv)), is_loaded=False)
