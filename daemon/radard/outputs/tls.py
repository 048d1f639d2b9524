"""Towards a server: whether its name can be one, whom it is checked against, and who we are."""

import re
import ssl
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

from radard.errors import ConfigError, UsageError
from x2radar.ports import is_host

LATE = "no answer within the time limit"


def client_context(
    section: str, ca_file: Path | None, cert_file: Path | None = None, key_file: Path | None = None
) -> ssl.SSLContext:
    """Return the context of a section of the configuration; ConfigError names its key."""
    key, file = "ca_file", ca_file
    try:
        context = ssl.create_default_context(cafile=ca_file)
        if cert_file is not None:
            key, file = "cert_file", cert_file
            context.load_cert_chain(cert_file, key_file)
    except (OSError, ValueError) as err:
        raise ConfigError(f"{section}.{key}: {file}: {err}") from err
    return context


def split_server(scheme: str, url: str) -> SplitResult:
    """Return the parts of a URL; UsageError, or ConfigError if no server can be at its host."""
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError as err:
        # What it quotes may be a password.
        why = str(err) if "'" not in str(err) else "no host has such a name and port"
        raise UsageError(f"--output {scheme}: {why}") from err
    authority = re.split(r"[/?#]", url.partition("://")[2], maxsplit=1)[0]
    name = re.sub(r":\d*$", "", authority.rpartition("@")[2]).strip("[]")
    is_zero = bool(re.search(r":0+$", authority)) and not authority.endswith("]")
    if not authority.isprintable() or (name and not is_host(name)) or is_zero:
        raise ConfigError(f"--output {scheme}: no host has such a name and port")
    return parts


def shown_host(host: str) -> str:
    """Return a host as it stands in a URL: an address of IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def explain(err: Exception) -> str:
    """Return why a connection failed, for people."""
    if isinstance(err, ssl.SSLCertVerificationError):
        return f"the server's certificate is not accepted: {err.verify_message}"
    if isinstance(err, TimeoutError):
        return LATE
    return str((isinstance(err, OSError) and err.strerror) or err)
