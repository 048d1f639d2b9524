"""The levers' table and plot."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from x2train.report.intervals import Estimate
from x2train.studies.levers.measure import Figures, of_lever


def table(figures: Sequence[Figures], n: int) -> Iterator[str]:
    """Yield the lines of the table; what is usual is bold."""
    yield f"{n} people and {n} visits of pets in every row; intervals hold 95 %."
    yield ""
    yield (
        "| lever | value | people missed, % | pets' visits with an alarm, % | alarm after, "
        "half / 90 % | ms a second | KiB/s |"
    )
    yield "|---|---|---|---|---|---|---|"
    for f in figures:
        value = f"**{f.case.value}**" if f.case.is_usual else f.case.value
        times = f"{_seconds(f.median_s)} / {_seconds(f.slow_s)}"
        yield (
            f"| {f.case.lever} | {value} | {_percent(f.missed)} | {_percent(f.pets)} | {times} "
            f"| {f.cpu_ms:.1f} | {f.kib_per_s:.0f} |"
        )


def draw(figures: Sequence[Figures], path: Path) -> None:
    """Draw missed people against pets' visits with an alarm, lever by lever."""
    levers = tuple(dict.fromkeys(f.case.lever for f in figures))
    figure = Figure(figsize=(10, 6.2), layout="constrained")
    axes = figure.subplots(2, -(-len(levers) // 2), sharex=True, sharey=True)
    for lever, ax in zip(levers, axes.flat, strict=False):
        rows = of_lever(figures, lever)
        x, y = [100 * f.pets.value for f in rows], [100 * f.missed.value for f in rows]
        ax.plot(x, y, "-", color="0.7")
        for f, px, py in zip(rows, x, y, strict=True):
            ax.plot(px, py, "o", color="C1" if f.case.is_usual else "C0")
            ax.annotate(f.case.value, (px, py), (4, 4), textcoords="offset points", fontsize=7)
        ax.set_title(lever.replace("`", ""))
        ax.grid(alpha=0.3)
    figure.supxlabel("pets' visits with an alarm, %")
    figure.supylabel("people missed, %")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _percent(e: Estimate) -> str:
    return f"{100 * e.value:.1f} ({100 * e.low:.1f} to {100 * e.high:.1f})"


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if value < float("inf") else "never"
