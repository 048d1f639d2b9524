"""Packages that are needed for one thing only: named, by their extra, where they are missing."""

from importlib import import_module
from typing import Any

from x2radar.errors import MissingExtra

DISTRIBUTION = "uwb-radar-alarm"  # `project.name` of pyproject.toml, for all three packages
EXTRAS = {
    "matplotlib": "plot",
    "pyarrow": "parquet",
    "mcap": "mcap",
    "pylsl": "lsl",
    "apprise": "notify",
    "shtab": "completion",
}
"""The extra of pyproject.toml that brings each package."""


def needed(module: str, *, what: str) -> Any:
    """Return a module of an optional package; `what` needs it, for people.

    Raises MissingExtra, one line that names the extra, if it is not installed or cannot be loaded.

    >>> needed("mcap.writer", what="MCAP files").__name__
    'mcap.writer'
    """
    try:
        return import_module(module)
    except (ImportError, RuntimeError) as err:
        package = module.partition(".")[0]
        extra = EXTRAS[package]
        name = (getattr(err, "name", None) or "").partition(".")[0]
        is_missing = isinstance(err, ModuleNotFoundError) and name == package
        why = "which is not installed" if is_missing else f"which fails: {err}"
        raise MissingExtra(f"{what}: needs {package}, {why}: {install_hint(extra)}") from err


def install_hint(extra: str) -> str:
    """Return the command that adds an extra.

    >>> install_hint("daemon")
    "pip install 'uwb-radar-alarm[daemon]'"
    """
    return f"pip install '{DISTRIBUTION}[{extra}]'"
