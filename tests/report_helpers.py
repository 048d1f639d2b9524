"""Tables of passages whose figures are known."""

import numpy as np

from x2train.judge.table import PassageTable, passage_columns


def passage(quiet, label="human", *, window=None, enters_s=2.0, is_open=True, **more):
    """Return a passage whose decisions, one a second from 2.0 s, have these fused p_quiet."""
    quiet = np.asarray(quiet, float)
    n = len(quiet)
    is_open = np.broadcast_to(np.asarray(is_open, bool), n)
    window = quiet if window is None else np.asarray(window, float)
    gone = np.where(is_open, 0.0, np.nan)
    facts = {"family": "walker" if label == "human" else "dog", "split": "held out"}
    facts |= {"duration_s": float(n), "leaves_s": np.nan if np.isnan(enters_s) else enters_s + n}
    columns = {"t_s": 2.0 + np.arange(n), "is_open": is_open, "is_pending": np.zeros(n, bool)}
    columns |= {"is_alarm": is_open & (quiet <= 0.8), "p_human": 1 - window + gone}
    columns |= {"p_pet": window + gone, "p_other": np.zeros(n) + gone}
    columns |= {"fused_quiet": quiet + gone, "fused_most": quiet + gone}
    levels = {"power_db": -50.0, "target_range_m": 2.0, "compensated_db": -40.0}
    columns |= {name: np.full(n, level) for name, level in levels.items()}
    return passage_columns(label=label, enters_s=enters_s, **{**facts, **columns, **more})


def table_of(*passages):
    """Return a table."""
    return PassageTable.of(passages)


FAMILIES = {
    "human": ("walker", "crawler", "runner", "stealthy", "person with dog"),
    "pet": ("dog, small", "dog, large", "cat", "cat at a run"),
    "other": ("fan", "curtain"),
    "empty": ("empty room",),
}


def drawn(n, seed=0, *, skill=6.0):
    """Return a table of n passages as a network of some skill (in log odds) might see them."""
    return table_of(*drawn_passages(n, seed, skill=skill))


def drawn_passages(n, seed=0, *, skill=6.0):
    """Return the same, one by one."""
    rng = np.random.default_rng(seed)
    return [_drawn(rng, k, skill) for k in range(n)]


def _drawn(rng, k, skill):
    label = str(rng.choice(["human", "pet", "other", "empty"], p=[0.45, 0.45, 0.07, 0.03]))
    family = str(rng.choice(FAMILIES[label]))
    is_human = label == "human"
    n = int(rng.integers(6, 40))
    mean = (1 if is_human else -1) * skill * rng.gamma(4, 0.25)
    mean *= 0.4 if family in ("crawler", "cat at a run") else 1.0
    llr = mean + rng.normal(0, 1.5, n)
    fused = llr.cumsum() / np.sqrt(np.arange(1, n + 1))
    quiet = 1 / (1 + np.exp(np.clip(fused, -600, 600)))
    power = rng.normal(-50, 6) + rng.normal(0, 2, n)
    range_m = rng.uniform(0.5, 3.0)
    is_open = np.ones(n, bool) if label != "empty" else rng.random(n) < 0.02
    never = label == "empty"
    seen = {"enters_s": np.nan if never else 2.0 + rng.uniform(0, 1), "family": family}
    seen |= {"split": str(rng.choice(["train families", "held-out family", "unseen room"]))}
    seen |= {"suite": f"walk test: {family}" if is_human and rng.random() < 0.5 else ""}
    seen |= {"speed_mps": np.nan if never else rng.gamma(3, 0.35), "build": f"build {k % 60}"}
    seen |= {"range_m": np.nan if never else range_m, "aspect_deg": rng.uniform(0, 180)}
    seen |= {"snr_db": np.nan if never else rng.normal(20, 6), "power_db": power}
    seen |= {"target_range_m": range_m + rng.normal(0, 0.2, n), "duration_s": float(n + 2)}
    seen |= {"compensated_db": power + 40 * np.log10(range_m), "is_open": is_open}
    return passage(quiet, label, window=1 / (1 + np.exp(np.clip(llr, -600, 600))), **seen)
