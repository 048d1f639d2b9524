"""Which process listens on a port, as Linux tells it."""

import contextlib
from pathlib import Path

_LISTEN = "0A"


def port_holder(port: int) -> str:
    """Return who listens on a TCP port, as 'process 812 (radard)'; empty if not to be seen."""
    wanted = {f"socket:[{inode}]" for inode in _listening(port)}
    if not wanted:
        return ""
    for process in Path("/proc").glob("[0-9]*"):
        # It may have ended since it was listed.
        with contextlib.suppress(OSError):
            if any(str(each.readlink()) in wanted for each in (process / "fd").iterdir()):
                name = (process / "comm").read_text(errors="replace").strip()
                return f"process {process.name} ({name})"
    return ""


def _listening(port: int) -> set[str]:
    """Return the inodes of sockets that listen on a port."""
    found = set()
    for table in ("tcp", "tcp6"):
        with contextlib.suppress(OSError):
            for line in Path("/proc/net", table).read_text("ascii").splitlines()[1:]:
                fields = line.split()
                if fields[3] == _LISTEN and int(fields[1].rpartition(":")[2], 16) == port:
                    found.add(fields[9])
    return found
