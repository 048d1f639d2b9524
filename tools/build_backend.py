"""setuptools' build backend, whose sdist and wheel are the same bytes from the same source.

Times are SOURCE_DATE_EPOCH, or the first that a zip can hold; owners, modes and order are always
the same, links become the files that they name. What an earlier build left behind is not packed.
"""

import gzip
import io
import os
import posixpath
import shutil
import tarfile
import time
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403 - the hooks that stay as they are

_FIRST_S = 315_532_800
"""1980-01-01, the first date of a zip (APPNOTE.TXT, 4.4.6)."""


def build_wheel(
    folder: str, settings: dict[str, Any] | None = None, metadata: str | None = None
) -> str:
    """Build the wheel (PEP 517)."""
    shutil.rmtree("build/lib", ignore_errors=True)
    name = build_meta.build_wheel(folder, settings, metadata)
    _same_zip(Path(folder, name))
    return name


def build_sdist(folder: str, settings: dict[str, Any] | None = None) -> str:
    """Build the source distribution (PEP 517)."""
    # setuptools packs what stands in it, also when pyproject.toml no longer says so.
    for left in Path().glob("*.egg-info/SOURCES.txt"):
        left.unlink()
    name = build_meta.build_sdist(folder, settings)
    _same_tar(Path(folder, name))
    return name


def _epoch_s() -> int:
    return max(int(os.environ.get("SOURCE_DATE_EPOCH", _FIRST_S)), _FIRST_S)


def _mode(mode: int) -> int:
    return 0o755 if mode & 0o100 else 0o644


def _same_zip(path: Path) -> None:
    with zipfile.ZipFile(path) as old:
        parts = [(info, old.read(info)) for info in old.infolist() if not info.is_dir()]
    # Metadata at the end, its list of files last (binary distribution format).
    parts.sort(key=lambda part: (".dist-info/" in part[0].filename, part[0].filename))
    parts.sort(key=lambda part: part[0].filename.endswith(".dist-info/RECORD"))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as new:
        for old_info, data in parts:
            info = zipfile.ZipInfo(old_info.filename, time.gmtime(_epoch_s())[:6])
            info.external_attr = (0o100000 | _mode(old_info.external_attr >> 16)) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            new.writestr(info, data)


def _same_tar(path: Path) -> None:
    with tarfile.open(path) as old:
        parts = {info.name: (info, _content(old, info)) for info in old if not info.isdir()}
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as new:
        for name in sorted(parts):
            old_info, data = parts[name]
            info = tarfile.TarInfo(name)
            info.size, info.mtime, info.mode = len(data), _epoch_s(), _mode(old_info.mode)
            new.addfile(info, io.BytesIO(data))
    with path.open("wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=_epoch_s()) as out:
        out.write(packed.getvalue())


def _content(tar: tarfile.TarFile, info: tarfile.TarInfo) -> bytes:
    """Return what a file holds; a link's target must be in the archive, too."""
    if info.issym():
        target = posixpath.join(posixpath.dirname(info.name), info.linkname)
        return _content(tar, tar.getmember(posixpath.normpath(target)))
    file = tar.extractfile(info)
    return b"" if file is None else file.read()
