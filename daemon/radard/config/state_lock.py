"""A lock on the state directory, so that two daemons do not share one; ends with the process."""

import contextlib
import fcntl
import logging
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from radard.config.config import Config
from radard.config.directories import log_path
from radard.errors import ConfigError

log = logging.getLogger("radard")


@contextlib.contextmanager
def state_lock(config: Config, environ: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Hold the state directory, if one is used; ConfigError while another daemon does."""
    path = log_path(config, environ)
    if path is None:
        yield
        return
    folder = path.parent
    with contextlib.ExitStack() as stack:
        try:
            fd = _locked(folder)
        except BlockingIOError as err:
            msg = f"{folder}: another radard uses this state directory; stop it, or name another "
            msg += "folder in service.state_dir (RADARD_SERVICE__STATE_DIR)"
            raise ConfigError(msg) from err
        except OSError as err:
            log.warning("%s: not locked against a second radard: %s", folder, err.strerror or err)
        else:
            stack.callback(os.close, fd)
        yield


def _locked(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise
    return fd
