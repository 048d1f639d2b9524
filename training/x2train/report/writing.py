"""Writing: report.json and report.html of a table of passages."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from radard.errors import OutputError
from x2train.report.compare import Pairing, check_same, pairings
from x2train.report.figures import Figures, figures
from x2train.report.report_json import document
from x2train.report.table import PassageTable


def write(
    table: PassageTable,
    out_dir: Path,
    *,
    title: str,
    other: PassageTable | None = None,
    render: Callable[[int], bytes | None] | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Write report.json and report.html of a model into a folder; return what is in the JSON.

    Parameters
    ----------
    table, other : PassageTable
        What the model said of each passage; what another one said of the same ones, to compare.
    out_dir, title : Path and str
        The folder, made when missing; headline of the page.
    render : callable, optional
        Index of a passage to its picture, a PNG, or None; asked for the worst twenty.
    seed : int
        Of the draws for the intervals.

    Returns
    -------
    dict
        As report.schema.json describes.

    Raises
    ------
    UsageError
        If `other` is of other passages.
    OutputError
        If the folder or a file cannot be written.
    """
    # Late: matplotlib takes a second, and a summary needs none.
    from x2train.report.page import page  # noqa: PLC0415

    here = figures(table, seed)
    there: Figures | None = None
    pairs: tuple[Pairing, ...] = ()
    if other is not None:
        check_same(table, other)
        there = figures(other, seed)
        pairs = pairings(table, here, there, seed)
    made = document(title, table, here, there, pairs)
    text = json.dumps(made, indent=1, allow_nan=False) + "\n"
    html = page(
        made, table, here, None if other is None or there is None else (other, there), render
    )
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        (out_dir / "report.json").write_text(text, encoding="utf-8")
        (out_dir / "report.html").write_text(html, encoding="utf-8")
    except OSError as err:
        msg = f"{out_dir}: cannot write the report: {err.strerror}"
        raise OutputError(msg) from err
    return made
