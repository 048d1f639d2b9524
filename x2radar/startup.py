"""The first moment of a command: signals and standard streams, before imports that take a second.

Nothing is loaded before its handlers stand but `signal` itself and `importlib`.
"""

import os
import signal
import sys

STOP = (signal.SIGINT, signal.SIGTERM)


def start(prog: str, module: str) -> int:
    """Run a command as a process, with standard streams and signals that it can rely on.

    A standard stream that is closed becomes the null device, so that no file which is opened later
    takes its number; stdout is UTF-8 whatever the locale, and takes names of files of any bytes.
    SIGINT and SIGTERM end the process with 0 until `interrupts`, also while `module` is imported;
    as process 1 of a container it would not even notice them.
    """
    for number in STOP:
        if signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, end_at_once)
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != descriptor:
                os.dup2(opened, descriptor)
                os.close(opened)
            mode = "w" if descriptor else "r"
            stream = open(descriptor, mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(encoding="utf-8", errors="surrogateescape")
    # Late: signals are heard before anything else is loaded.
    from importlib import import_module  # noqa: PLC0415

    run = import_module("x2radar.command").run_command
    return int(run(prog, lambda argv: int(import_module(module).main(argv)), is_loaded=False))


def end_at_once(_number: int, _frame: object) -> None:
    """End the process with 0, whatever it is doing."""
    os._exit(0)
