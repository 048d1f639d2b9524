"""The combinations of `train-export tradeoff`: their table and their plot."""

from matplotlib.axes import Axes

from research.tradeoff.combinations import PRECISIONS, SETTINGS, Combination, best

_MARKS = {3: "o", 2: "s", 1: "^"}


def grid_section(made: list[Combination], n_windows: int, n_passages: int) -> list[str]:
    """Return the section of the page, as lines of Markdown; none without combinations."""
    if not made:
        return []
    models = tuple(dict.fromkeys(c.model for c in made))
    columns = [(model, precision) for model in models for precision in PRECISIONS]
    found = {(c.model, c.precision, c.decimation, c.cpis): c for c in made}
    widest = max(c.auc.high - c.auc.low for c in made) / 2
    lines = [
        "## Combinations",
        "",
        f"Window AUC, people against pets, over {n_windows} windows of {n_passages} simulated",
        "passages before an X2 with all its bins, the same dwells in every row. *Range*: how",
        "many bins become one; *CPIs*: how many velocity-time maps the network is shown, the",
        "others are blank. **ms**: CPU time of a hop without network; that of the network is in",
        "the second row. **Bold** is as shipped, a star that nothing else is both cheaper and",
        f"better. 95 % intervals (passages resampled) reach {widest:.3f} to either side at most,",
        "less for differences. No network was retrained: one made for what it is shown might do",
        "better. Weights in int8 use seven bits: without dot-product instructions (VNNI)",
        "onnxruntime adds pairs of products in 16 bits, which eight-bit weights saturate (one",
        "probability was off by 0.76).",
        "",
        "| range | CPIs | ms | " + " | ".join(f"{m}, {p}" for m, p in columns) + " |",
        "|---|---|---|" + "---|" * len(columns),
    ]
    costs = (found[m, p, SETTINGS[0].decimation, SETTINGS[0].cpis].network_ms for m, p in columns)
    lines.append("| | | network, ms: | " + " | ".join(f"{ms:.2f}" for ms in costs) + " |")
    front = best(made)
    for setting in SETTINGS:
        row = [found[m, p, setting.decimation, setting.cpis] for m, p in columns]
        chain_ms = row[0].ms_per_hop - row[0].network_ms
        lines.append(
            f"| {setting.decimation} | {setting.cpis} | {chain_ms:.2f} | "
            + " | ".join(_cell(c, is_best=c in front) for c in row)
            + " |"
        )
    return lines


def _cell(made: Combination, *, is_best: bool) -> str:
    text = f"**{made.auc.value:.3f}**" if made.is_shipped else f"{made.auc.value:.3f}"
    return f"{text} *" if is_best else text


def draw_combinations(axis: Axes, made: list[Combination]) -> None:
    """Draw accuracy against cost, all combinations, and ring the shipped ones."""
    models = tuple(dict.fromkeys(c.model for c in made))
    for c in made:
        colour = f"C{models.index(c.model)}"
        is_whole = c.precision == PRECISIONS[0]
        axis.plot(
            c.ms_per_hop,
            c.auc.value,
            _MARKS[c.cpis],
            color=colour,
            markerfacecolor=colour if is_whole else "none",
            markersize=5,
        )
        if c.is_shipped:
            axis.plot(c.ms_per_hop, c.auc.value, "*", color=colour, markersize=15, label=c.model)
    front = best(made)
    axis.plot(
        [c.ms_per_hop for c in front],
        [c.auc.value for c in front],
        "-",
        color="0.6",
        linewidth=1,
        zorder=0,
    )
    for cpis, mark in _MARKS.items():
        axis.plot([], [], mark, color="0.4", markersize=5, label=f"CPIs: {cpis}")
    axis.plot([], [], "o", color="0.4", markerfacecolor="none", markersize=5, label="int8")
    axis.set(
        xlabel="CPU per hop, ms",
        ylabel="window AUC",
        title="combinations (star: as shipped)",
    )
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7, loc="lower right")
