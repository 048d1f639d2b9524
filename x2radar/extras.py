"""Packages that are needed for one thing only: named, by their extra, where they are missing."""

from importlib import import_module
from typing import Any

from x2radar.distribution import install_hint
from x2radar.errors import MissingExtra

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
    """Return a module of an optional package.

    Parameters
    ----------
    module : str
        Full name, such as ``pyarrow.parquet``.
    what : str
        What asks for it, for people: ``Parquet files``.

    Raises
    ------
    MissingExtra
        If it is not installed, or cannot be loaded; one line that names the extra.

    Examples
    --------
    >>> needed("mcap.writer", what="MCAP files").__name__
    'mcap.writer'
    """
    try:
        return import_module(module)
    except (ImportError, RuntimeError) as err:
        package = module.partition(".")[0]
        extra = EXTRAS[package]
        why = "which is not installed" if _is_missing(err, package) else f"which fails: {err}"
        msg = f"{what}: needs {package}, {why}: {install_hint(extra)}"
        raise MissingExtra(msg) from err


def _is_missing(err: Exception, package: str) -> bool:
    name = getattr(err, "name", None) or ""
    return isinstance(err, ModuleNotFoundError) and name.partition(".")[0] == package
