"""The page and its pictures: results, bodies, pulse; elements are in `element_pictures`."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

import matplotlib.pyplot as plt
import torch
from matplotlib.axes import Axes

from x2radar.atomic import write_whole
from x2radar.errors import WriteError
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, ranges_xyz
from x2radar.sim.signal.pulse import pulse_sigma_s
from x2train.thesis.cells import RATES_HZ
from x2train.thesis.element_pictures import features, five_scatterers, profiles, save
from x2train.thesis.elements import BODIES
from x2train.thesis.mlp import ACTIVATIONS
from x2train.thesis.page import MAIN, page
from x2train.thesis.recipe import StudyRecipe
from x2train.thesis.results import CellResult

_CLASSES = ("pet", "person")
_MOVED_S = 0.3  # limbs are apart


def pulse(path: Path) -> Path:
    """Draw the transmitted pulse and its spectrum (2.3, 2.5)."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3))
    carrier_hz, sigma_s = 6.8e9, pulse_sigma_s(2.3e9)
    t_s = np.linspace(-1e-9, 1e-9, 2001)
    envelope = np.exp(-(t_s**2) / (2 * sigma_s**2))
    left.plot(t_s * 1e9, envelope * np.cos(2 * np.pi * carrier_hz * t_s), lw=0.8)
    left.plot(t_s * 1e9, envelope, "k--", lw=0.8)
    left.set(xlabel="fast time (ns)", ylabel="amplitude", title="pulse")
    f_hz = np.linspace(4e9, 10e9, 600)
    level_db = 20 * np.log10(np.exp(-2 * (np.pi * (f_hz - carrier_hz) * sigma_s) ** 2))
    right.plot(f_hz / 1e9, level_db)
    right.axhline(-10, color="k", ls=":", lw=0.8)
    right.set(xlabel="frequency (GHz)", ylabel="dB", ylim=(-40, 2), title="spectrum")
    return save(figure, path)


def activations(path: Path) -> Path:
    """Draw the activation functions (3.23, 3.25)."""
    figure, axes = plt.subplots(figsize=(4, 3))
    x = torch.linspace(-6, 6, 200)
    for name, function in ACTIVATIONS.items():
        axes.plot(x.numpy(), function()(x).numpy(), label=name)
    axes.set(xlabel="input", ylabel="output", ylim=(-1.2, 2.5))
    axes.legend()
    return save(figure, path)


def bodies(path: Path) -> Path:
    """Draw the scatterer models from above, after they have moved a little (4.1-4.3)."""
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.2), sharey=True)
    for axis, (name, points) in zip(axes, THESIS_BODIES.items(), strict=True):
        position_m, rcs_m2 = ranges_xyz(points, np.array([_MOVED_S]))
        axis.scatter(position_m[0, :, 0], position_m[0, :, 1], s=2 * np.sqrt(rcs_m2), alpha=0.6)
        axis.plot(0, 0, "k^")
        axis.annotate("radar", (0, 0), (0.05, 0.1))
        axis.set(title=name, xlabel="x (m)", xlim=(-0.6, 0.6), ylim=(-0.2, 3.4))
    axes[0].set_ylabel("y (m)")
    return save(figure, path)


def confusions(path: Path, results: list[CellResult]) -> Path:
    """Draw confusion plots in the thesis' layout (table 3.1): rows are what the network says."""
    n_across = 4
    n_down = -(-len(results) // n_across)
    figure, axes = plt.subplots(n_down, n_across, figsize=(12, 3.1 * n_down), squeeze=False)
    for axis in axes.ravel()[len(results) :]:
        axis.axis("off")
    for axis, result in zip(axes.ravel(), results, strict=False):
        _confusion(axis, np.array(result.evaluation.confusion[result.best]))
        axis.set_title(f"{result.name} {result.label}", fontsize=10)
    figure.tight_layout()
    return save(figure, path)


def _confusion(axis: Axes, counts: NDArray[np.int64]) -> None:
    total = max(int(counts.sum()), 1)
    cells = np.full((3, 3), 0.5)
    text = np.empty((3, 3), object)
    for r in (0, 1):
        for c in (0, 1):
            cells[r, c] = 1.0 if r == c else 0.0
            text[r, c] = f"{counts[r, c]}\n{100 * counts[r, c] / total:.1f} %"
        text[r, 2] = _shares(counts[r, r], counts[r].sum())
        text[2, r] = _shares(counts[r, r], counts[:, r].sum())
    text[2, 2] = _shares(np.trace(counts), total)
    axis.imshow(cells, cmap="RdYlGn", vmin=-0.6, vmax=1.6)
    for r in range(3):
        for c in range(3):
            axis.text(c, r, text[r, c], ha="center", va="center", fontsize=9)
    axis.set_xticks((0, 1, 2), (*_CLASSES, ""))
    axis.set_yticks((0, 1, 2), (*_CLASSES, ""))
    axis.set_xlabel("target class")
    axis.set_ylabel("output class")


def _shares(right: int, of: int) -> str:
    share = 100 * right / max(of, 1)
    return f"{share:.1f} %\n{100 - share:.1f} %" if of else "-"


def confidence(path: Path, result: CellResult) -> Path:
    """Draw the mean probability of the true class over epochs (5.1, 5.2)."""
    values = np.array(result.confidence)
    best = np.array(result.scores)[1:].min(axis=0)
    epochs = np.arange(len(values)) * int(result.settings["fit"]["look_every"])
    figure, axes = plt.subplots(1, 2, figsize=(9, 3), sharey=True)
    pairs = (("good", int(best.argmin())), ("poor", int(best.argmax())))
    for axis, (kind, k) in zip(axes, pairs, strict=True):
        for c, name in enumerate(_CLASSES):
            axis.plot(epochs, values[:, k, c], "o-", label=f"class {c + 1}, {name}")
        title = f"{result.name} {result.label}: {kind} initialisation"
        axis.set(xlabel="epoch of the whole network", title=title, ylim=(0.4, 1))
    axes[0].set_ylabel("confidence")
    axes[0].legend()
    return save(figure, path)


def publish(
    recipe: StudyRecipe, results: Sequence[CellResult], path: Path, commands: tuple[str, str, str]
) -> Path:
    """Write tables of results, and pictures into a folder of the page's name beside it."""
    try:
        return _publish(recipe, results, path, commands)
    except OSError as err:
        raise WriteError.of(path, err) from err


def _publish(
    recipe: StudyRecipe, results: Sequence[CellResult], path: Path, commands: tuple[str, str, str]
) -> Path:
    folder = path.parent / path.stem
    main = [r for r in results if r.label in MAIN]
    pictures: dict[str, list[Path]] = {}
    if main:
        pictures["Confusion (table 3.1, appendix C)"] = [
            confusions(folder / f"confusion-{label}.png", chosen)
            for label in MAIN
            if (chosen := [r for r in main if r.label == label])
        ]
        drawn = [
            confidence(folder / f"confidence-{r.label}.png", r)
            for label in MAIN
            if (r := _widest([m for m in main if m.label == label])) is not None
        ]
        pictures["Confidence over epochs, a good and a poor initialisation (5.1, 5.2)"] = drawn
    made = [five_scatterers(folder / "five-scatterers.png")]
    made += [
        features(folder, recipe.spec(rate_hz), body) for rate_hz in RATES_HZ for body in BODIES
    ]
    made.append(profiles(folder / "profiles.png", recipe.spec(60)))
    pictures["G, µ, D and both vectors (figures 2.5-2.7, 3.7-3.9)"] = made
    pictures["Scatterers from above (figures 4.1-4.3)"] = [bodies(folder / "bodies.png")]
    pictures["Pulse and activation functions"] = [
        pulse(folder / "pulse.png"),
        activations(folder / "activations.png"),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    text = page(results, pictures, commands=commands, folder=path.parent)
    write_whole(path, text.encode())
    return path


def _widest(results: Sequence[CellResult]) -> CellResult | None:
    """Return the result whose repeats differ most in score at their best."""
    spread = [float(np.ptp(np.min(r.scores[1:], axis=0))) for r in results]
    return results[int(np.argmax(spread))] if results else None
