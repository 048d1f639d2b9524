"""Write the page and its pictures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from x2radar.errors import RecordingError
from x2train.sets.shards import write_whole
from x2train.thesis import figures, plots
from x2train.thesis.cells import RATES_HZ
from x2train.thesis.page import MAIN, page
from x2train.thesis.recipe import StudyRecipe
from x2train.thesis.results import CellResult

_EXAMPLE = 3  # number of the element that is drawn: chosen


def publish(recipe: StudyRecipe, results: Sequence[CellResult], path: Path, command: str) -> Path:
    """Write tables of results, and pictures into a folder of the page's name beside it.

    The page says that `command` made it. Raises RecordingError if the disk does not take it.
    """
    try:
        return _publish(recipe, results, path, command)
    except OSError as err:
        msg = f"{path}: cannot write the page or its pictures: {err.strerror or err}"
        raise RecordingError(msg) from err


def _publish(recipe: StudyRecipe, results: Sequence[CellResult], path: Path, command: str) -> Path:
    folder = path.parent / path.stem
    main = [r for r in results if r.label in MAIN]
    pictures: dict[str, list[Path]] = {}
    if main:
        pictures["Confusion (table 3.1, appendix C)"] = [
            plots.confusions(folder / f"confusion-{label}.png", chosen)
            for label in MAIN
            if (chosen := [r for r in main if r.label == label])
        ]
        drawn = [
            plots.confidence(folder / f"confidence-{r.label}.png", r)
            for label in MAIN
            if (r := _widest([m for m in main if m.label == label])) is not None
        ]
        pictures["Confidence over epochs, a good and a poor initialisation (5.1, 5.2)"] = drawn
    made = [
        figures.features(folder, recipe.spec(rate_hz), body, _EXAMPLE)
        for rate_hz in RATES_HZ
        for body in ("human", "dog", "cat")
    ]
    pictures["G, µ, D and both vectors (figures 2.5-2.7, 3.7-3.9)"] = made
    pictures["Scatterers from above (figures 4.1-4.3)"] = [plots.bodies(folder / "bodies.png")]
    pictures["Pulse and activation functions"] = [
        plots.pulse(folder / "pulse.png"),
        plots.activations(folder / "activations.png"),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    text = page(results, pictures, command=command, folder=path.parent)
    write_whole(path, text.encode())
    return path


def _widest(results: Sequence[CellResult]) -> CellResult | None:
    """Return the result whose repeats differ most in score at their best."""
    spread = [float(np.ptp(np.min(r.scores[1:], axis=0))) for r in results]
    return results[int(np.argmax(spread))] if results else None
