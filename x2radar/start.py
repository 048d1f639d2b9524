"""Starts a command as a process."""

from x2radar.startup import begin


def start(prog: str, module: str) -> int:
    """Run a command as a process; a signal while `module` is imported ends it at once."""
    begin()
    # Late: signals are heard before anything else is loaded.
    from importlib import import_module  # noqa: PLC0415

    from x2radar.command import run_command  # noqa: PLC0415

    return run_command(prog, lambda argv: int(import_module(module).main(argv)), is_loaded=False)
