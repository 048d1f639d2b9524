"""Cases: one setting changed at a time, everything else as usual."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from x2train.judge.acceptance import Setting
from x2train.judge.installed import KNOWS, Knows
from x2train.sets.sites import X2

USUAL = Setting(X2, "1.2 m, level", 1.2, 0.0, 3.0)
"""The lower of the acceptance test's mounts."""
_MOUNTS = (
    Setting(X2, "0.6 m, level", 0.6, 0.0, 3.0),
    USUAL,
    Setting(X2, "2.2 m, 23 degrees down", 2.2, 23.0, 2.7),
    Setting(X2, "ceiling, 2.6 m, 60 degrees down", 2.6, 60.0, 2.0),
)
_RATES_HZ = (30.0, 60.0, 100.0, 200.0)
_WITHIN_S = (0.0, 3.0, 5.0, 8.0)
_HOPS_S = (0.5, 1.0, 2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of the table."""

    lever: str
    value: str
    setting: Setting = USUAL
    model: str
    within_s: float = 3.0  # `decision.decide_within_s`
    hop_s: float = 1.0
    knows: Knows = "nothing"  # of the installation
    is_usual: bool = False  # nothing is changed


def cases(models: tuple[str, ...]) -> Iterator[Case]:
    """Yield every case; the first of the models is the usual one."""
    unchanged = Case(lever="", value="", model=models[0])
    for case in _cases(models):
        yield replace(case, is_usual=replace(case, lever="", value="") == unchanged)


def _cases(models: tuple[str, ...]) -> Iterator[Case]:
    usual = models[0]
    for rate_hz in _RATES_HZ:
        setting = replace(USUAL, radar=replace(X2, frame_rate_hz=rate_hz))
        yield Case(lever="frame rate", value=f"{rate_hz:g} Hz", setting=setting, model=usual)
    for setting in _MOUNTS:
        yield Case(lever="mount", value=setting.mount, setting=setting, model=usual)
    for model in models:
        yield Case(lever="bundle", value=model, model=model)
    for within_s in _WITHIN_S:
        yield Case(
            lever="`decide_within_s`", value=f"{within_s:g} s", model=usual, within_s=within_s
        )
    for hop_s in _HOPS_S:
        yield Case(lever="hop", value=f"{hop_s:g} s", model=usual, hop_s=hop_s)
    for known in KNOWS:
        yield Case(lever="what `mount` says", value=known, model=usual, knows=known)
