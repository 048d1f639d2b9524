"""The name under which x2radar, radard and x2train are installed, all from one distribution."""

DISTRIBUTION = "uwb-radar-alarm"
"""`project.name` of pyproject.toml."""


def install_hint(extra: str) -> str:
    """Return the command that adds an extra.

    >>> install_hint("daemon")
    "pip install 'uwb-radar-alarm[daemon]'"
    """
    return f"pip install '{DISTRIBUTION}[{extra}]'"
