"""The levers' table and plot."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from research.levers.measure import Figures
from x2train.report.intervals import Estimate


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
    """Draw what each value does to misses and to pets' alarms, a row each, with 95 % intervals."""
    figure = Figure(figsize=(9, 0.8 + 0.3 * len(figures)), layout="constrained")
    of_people, of_pets = figure.subplots(1, 2, sharey=True, width_ratios=(1, 2))
    for row, f in enumerate(figures):
        colour = "C1" if f.case.is_usual else "C0"
        for ax, e in ((of_people, f.missed), (of_pets, f.pets)):
            ax.plot([100 * e.low, 100 * e.high], [row, row], color=colour, alpha=0.4, lw=3)
            ax.plot(100 * e.value, row, "o", color=colour)
    levers = [f.case.lever.replace("`", "") for f in figures]
    for ax, title in ((of_people, "people missed, %"), (of_pets, "pets' visits with an alarm, %")):
        ax.set(title=title, xlim=(0, None))
        ax.grid(axis="x", alpha=0.3)
        for row in range(1, len(figures)):
            if levers[row] != levers[row - 1]:
                ax.axhline(row - 0.5, color="0.6", lw=0.8)
    names = [f"{lever}:  {f.case.value}" for lever, f in zip(levers, figures, strict=True)]
    of_people.set_yticks(range(len(figures)), names)
    of_people.invert_yaxis()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _percent(e: Estimate) -> str:
    return f"{100 * e.value:.1f} ({100 * e.low:.1f} to {100 * e.high:.1f})"


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if value < float("inf") else "never"
