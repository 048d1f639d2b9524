"""Folders that need no configuration: the state's, and a private one among temporary files."""

import atexit
import contextlib
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from radard.errors import ConfigError


def named_state_folder(named: Path | None, environ: Mapping[str, str]) -> Path | None:
    """Return the folder that configuration (`named`) or systemd names for state, if any."""
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return named or (Path(given) if given else None)


def state_folder(named: Path | None, environ: Mapping[str, str]) -> Path:
    """Return the folder of what is kept over a restart: the named one, else the user's.

    A user without a home, as a number that a container was given, has one among the temporary
    files. Raises ConfigError if somebody else could write there.
    """
    if (folder := named_state_folder(named, environ)) is not None:
        return folder
    if home := environ.get("XDG_STATE_HOME"):
        return Path(home) / "radard"
    try:
        return Path.home() / ".local" / "state" / "radard"
    except RuntimeError as err:
        if (folder := temporary_folder()) is not None:
            return folder / "state"
        msg = "there is no home folder to keep state in: name one in service.state_dir"
        raise ConfigError(msg) from err


def made_up_folder(*, named: Path | None, environ: Mapping[str, str]) -> Path:
    """Return the folder of what a simulated or replayed sensor is told: named, or its own.

    What was tried on a demo's page must change no later run, so that one ends with the process.
    """
    return named_state_folder(named, environ) or own_folder()


@cache
def own_folder() -> Path:
    """Return the folder of what simulated and replayed sensors are told in this process."""
    # Made by the first who writes there, and by nobody else: its name cannot be guessed.
    folder = Path(tempfile.gettempdir()) / f"radard-{secrets.token_hex(12)}"
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def temporary_folder() -> Path | None:
    """Return radard-UID among the temporary files, made if need be; None unless it is private.

    Everybody may write there, so somebody else could have made it.
    """
    folder = Path(tempfile.gettempdir()) / f"radard-{os.getuid()}"
    try:
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
    except OSError:
        return None
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return folder if is_own and not found.st_mode & 0o077 else None
