"""Recorded and simulated walks beside each other, by eye."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from research.scene.plot import draw_range_time, draw_velocity_time, pictures
from research.walks.comparison import Comparison

SHOWN_MPS = 1.5  # chosen: what 30 frames a second leave
_DPI = 72  # chosen for the size of the file


def plot_walks(comparison: Comparison, path: Path) -> Path:
    """Draw range over time and velocity over time of every walk into a file; return it."""
    pairs = zip(comparison.recorded, comparison.simulated, strict=True)
    columns = [
        (walk, f"radar {k + 1}, {what}")
        for k, pair in enumerate(pairs)
        for walk, what in zip(pair, ("recorded", "simulated"), strict=True)
    ]
    figure, axes = plt.subplots(2, len(columns), figsize=(3.6 * len(columns), 6.4), squeeze=False)
    for k, (walk, title) in enumerate(columns):
        shown = pictures(walk.frames, walk.axis, walk.frame_rate_hz)
        draw_range_time(axes[0, k], shown)
        draw_velocity_time(axes[1, k], shown)
        axes[0, k].set_title(title)
        axes[1, k].set(title="", ylim=(-SHOWN_MPS, SHOWN_MPS))
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)
    return path
