"""The page and the plot of `train-export tradeoff`."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from research.tradeoff.combinations import Combination
from research.tradeoff.grid_page import draw_combinations
from research.tradeoff.measure import SWITCHES, Switch, SwitchRow
from research.tradeoff.models import ModelRow

_PICTURES = {
    "velocity_time": "velocity-time",
    "velocity_time_medium": "medium CPI",
    "velocity_time_long": "long CPI",
    "range_time": "range-time",
    "spectrogram": "spectrogram",
}
_MEANING = {
    "decimation": "Bins of 3.7 mm times this. The matched filter comes first, so no noise folds.",
    "stride": "Frames from one velocity column to the next; pictures have cells of 50 ms.",
    "step_mps": "401, 201, 101, 51 and 25 rows from -5 to 5 m/s. A CPI of 0.2 s resolves "
    "0.15 m/s.",
    "cpis": "CPIs of 0.2, 0.6 and 1.5 s; of 0.2 and 0.6 s; of 0.2 s alone. What the longer ones "
    "are worth to a network that is trained so: [what was tried](research/evaluation-tried.md).",
    "precision": "Arithmetic of the maps; frames are float32 either way.",
    "source": "RF that is down-converted here, or baseband that the module made. The loss is "
    "mostly another draw of the receiver's noise.",
    "bands": "Spectrogram alone. One band is what sums over range leave of it.",
}
_LEAST_LOSS_DB = 1e-3  # drawn for none
_N_ACROSS = 3  # plots in a row


def page(
    rows: list[SwitchRow],
    models: list[ModelRow],
    grid: list[str],
    *,
    how: str,
    command: str,
    plot: str,
) -> str:
    """Return the page in Markdown.

    `how` is a sentence on scenes and machine, `command` what made it, `plot` where the plot lies
    from the page; `models` and `grid`, the section of `grid_section`, may be empty.
    """
    parts = [
        "# Speed against accuracy",
        "",
        f"Made by `{command}`. Do not edit: run it again.",
        "",
        how,
        "",
        "**ms** is the CPU time of one hop (one a second) with an open gate: down-conversion,",
        "clutter and jitter, maps, pictures. **ratio** is that against the switch's finest value",
        "in the same run. **loss** is how far a picture is from the one of the finest value,",
        "everything else alike: rms over all that either shows, in dB (25 dB deep for the",
        "short CPI, 30 dB for the others); pictures that stay alike are left out. **Bold** is",
        "what the shipped bundles have.",
        "",
        f"![loss against cost]({plot})",
        "",
    ]
    for switch in SWITCHES:
        own = [row for row in rows if row.switch == switch.name]
        if own:
            parts += [*_table(switch, own), ""]
    parts += _model_table(models)
    if grid:
        parts += ["", *grid]
    return "\n".join(parts).rstrip("\n") + "\n"


def _table(switch: Switch, rows: list[SwitchRow]) -> list[str]:
    # What a switch does not change is not worth a column.
    names = [name for name in rows[0].loss_db if any(row.loss_db.get(name) != 0 for row in rows)]
    heads = " | ".join(f"loss {_PICTURES[name]}, dB" for name in names)
    lines = [
        f"## {switch.title[:1].upper()}{switch.title[1:]}",
        "",
        _MEANING[switch.name],
        "",
        f"| value | ms | ratio | {heads} |",
        "|---|---|---|" + "---|" * len(names),
    ]
    for row in rows:
        value = f"**{row.value}**" if row.is_default else f"{row.value}"
        losses = " | ".join(
            f"{row.loss_db[name]:.2g}" if name in row.loss_db else "not made" for name in names
        )
        lines.append(f"| {value} | {row.ms_per_hop:.2f} | {row.ratio:.2f} | {losses} |")
    return lines


def _model_table(models: list[ModelRow]) -> list[str]:
    if not models:
        return []
    lines = [
        "## Bundles",
        "",
        "CPU of one hop of the daemon with an open gate, every track judged by itself, timed in",
        "this run; accuracy over windows from each bundle's evaluation, with its 95 % interval.",
        "Only accuracies of evaluations on the same windows can be compared.",
        "",
        "| bundle | ms | of it network | accuracy |",
        "|---|---|---|---|",
    ]
    for model in sorted(models, key=lambda each: each.ms_per_hop):
        name = f"**{model.name}** (profile)" if model.is_profile else model.name
        lines.append(
            f"| {name} | {model.ms_per_hop:.2f} | {model.network_ms:.2f} | {_accuracy(model)} |"
        )
    return lines


def _accuracy(model: ModelRow) -> str:
    found = model.accuracy
    if found is None:
        return "not evaluated"
    if found.low is None or found.high is None:
        return f"{found.value:.4f}"
    return f"{found.value:.4f} ({found.low:.4f} to {found.high:.4f})"


def draw(
    rows: list[SwitchRow], models: list[ModelRow], combined: list[Combination], path: Path
) -> None:
    """Draw loss against cost, and accuracy against cost.

    Of combinations, or, without any, of bundles that were evaluated.
    """
    judged = [model for model in models if model.accuracy is not None]
    n_rows = -(-(len(_PICTURES) + bool(judged or combined)) // _N_ACROSS)
    figure, grid = plt.subplots(
        n_rows, _N_ACROSS, figsize=(4.8 * _N_ACROSS, 4.4 * n_rows), layout="constrained"
    )
    axes = grid.ravel()
    for axis, name in zip(axes, _PICTURES, strict=False):
        _draw_losses(axis, rows, name)
    if combined:
        draw_combinations(axes[-1], combined)
    elif judged:
        _draw_models(axes[-1], judged)
    else:
        axes[-1].set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    # No time stamp: the same figures give the same file.
    figure.savefig(path, dpi=110, metadata={"Software": None} if path.suffix == ".png" else None)
    plt.close(figure)


def _draw_losses(axis: Axes, rows: list[SwitchRow], name: str) -> None:
    for k, switch in enumerate(SWITCHES):
        own = [row for row in rows if row.switch == switch.name and name in row.loss_db]
        if not any(row.loss_db[name] > 0 for row in own):
            continue
        x = [row.ms_per_hop for row in own]
        y = [max(row.loss_db[name], _LEAST_LOSS_DB) for row in own]
        colour = f"C{k}"
        axis.plot(x, y, "o-", color=colour, markersize=4, linewidth=1, label=switch.title)
        for row, at_x, at_y in zip(own, x, y, strict=True):
            weight = "bold" if row.is_default else "normal"
            axis.annotate(
                f"{row.value}",
                (at_x, at_y),
                textcoords="offset points",
                xytext=(4, 3),
                fontsize=7,
                color=colour,
                fontweight=weight,
            )
    axis.set(
        xlabel="CPU per hop, ms",
        ylabel="loss, dB rms (1e-3: none)",
        title=f"{_PICTURES[name]} picture",
        yscale="log",
        ylim=(_LEAST_LOSS_DB / 2, None),
    )
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7)


def _draw_models(axis: Axes, models: list[ModelRow]) -> None:
    for model in models:
        found = model.accuracy
        assert found is not None  # noqa: S101 - the caller's choice
        low = found.value if found.low is None else found.low
        high = found.value if found.high is None else found.high
        axis.errorbar(
            model.ms_per_hop,
            found.value,
            yerr=[[found.value - low], [high - found.value]],
            fmt="*" if model.is_profile else "o",
            markersize=12 if model.is_profile else 5,
            capsize=3,
        )
        axis.annotate(
            model.name,
            (model.ms_per_hop, found.value),
            textcoords="offset points",
            xytext=(8, -10),
            fontsize=8,
            fontweight="bold" if model.is_profile else "normal",
        )
    axis.set(xlabel="CPU per hop, ms", ylabel="accuracy over windows", title="bundles")
    axis.grid(visible=True, alpha=0.3)
