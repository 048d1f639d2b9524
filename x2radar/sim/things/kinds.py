"""Things that move and must not alarm: curtain, fan, robot vacuum, washing machine and others.

`THINGS` names them. A thing is made once, with everything about it drawn from a generator,
and then gives its points at any times, without state. Frequencies, swings and speeds are
what such things do at home, by our judgement where no source is given beside a number.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from x2radar.keys import place_of
from x2radar.sim.points import Array, Mover, Points, Thing
from x2radar.sim.things import draws
from x2radar.sim.things.draws import Draw, ThingKind, Values, values_of

_WAVES = 3  # along a curtain: fewer repeat themselves
_GRAVITY = 9.81
_N_LEAVES = 12  # so many that none stands out
# Successive drops of one track start where a golden section takes them: never twice alike.
_GOLDEN = 0.618_033_988_749_895
# Points a blade; rate of tumbling, how long it tumbles, runs up and spins (a washing
# programme in short), and the damping of the drum.
_PER_BLADE = 3
_TUMBLE_HZ = 0.8
_TUMBLE_S, _RAMP_S, _SPIN_S = 12.0, 10.0, 18.0
_DAMPING = 0.2
# By what such machines do: after how long the way is repeated, how fast it turns, how far
# and fast it backs off, points of the rim and bristles of the brush.
_LOOP_S = 600.0
_TURN_DEG_PER_S = 100.0
_BACK_M, _BACK_MPS = 0.04, 0.1
_N_RIM = 8
_BRISTLES = 3


def _curtain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a panel of points; waves run along it, growing from the rod down to the hem.

    Displacement across the panel is ``A g (h) sum_k a_k sin(2 pi (f_k t - u / L_k) + p_k)``
    with ``sum a_k = 1``, so it never exceeds the amplitude A.
    """
    across, up = draws.grid(values["width_m"], values["height_m"], 7, 4)
    n = across.size
    right, ahead = draws.facing(values["heading_deg"])
    folds_m = rng.uniform(-0.04, 0.04, n)
    rest_m = across[:, None] * right + folds_m[:, None] * ahead
    rest_m += [*position_m, values["floor_gap_m"]]
    rest_m[:, 2] += up
    swing_m = values["amplitude_m"] * (1 - up / values["height_m"])
    share, start, length, sense = rng.random((4, _WAVES))
    share = (0.2 + share) / (0.2 + share).sum()
    hz = values["frequency_hz"] * np.array([1.0, 1.37, 0.61])
    wave_per_m = np.where(sense < 0.5, -1, 1) / (0.5 + 1.5 * length)
    start = start - across[:, None] * wave_per_m
    gust = draws.draw_gust(rng, 0.05, 0.3)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, n)

    def points(t_s: Array, antenna_m: Array) -> Points:
        wave = np.sin(2 * np.pi * (t_s[:, None, None] * hz + start)) @ share
        away_m = wave * swing_m * (0.3 + 0.7 * gust(t_s))[:, None]
        position_m = rest_m + away_m[..., None] * ahead
        aspect = 0.3 + 0.7 * draws.lit(ahead, position_m, antenna_m) ** 2
        return Points(position_m, rcs_m2 * aspect)

    return Thing(draws.numbered("cloth", n), points)


def _door(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a leaf on its hinge that opens, stands, shuts and rests, again and again."""
    across, up = draws.grid(values["width_m"], values["height_m"], 6, 4)
    hinge_m, out_m = np.array([*position_m, 0.0]), across + values["width_m"] / 2
    up_m = np.stack([0 * up, 0 * up, up], axis=1)
    swing_deg = values["swing_deg"] * (1 if rng.random() < 0.5 else -1)
    move_s, rest_s = values["move_s"], values["rest_s"]
    ends_s = np.cumsum([move_s, rest_s, move_s * rng.uniform(0.5, 1.2), rest_s])
    opened, stood, shut, over = ends_s
    begin_s = rng.uniform(0, over)
    sway = draws.draw_gust(rng, 0.2, 0.8)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, across.size)

    def points(t_s: Array, antenna_m: Array) -> Points:
        now_s = (t_s + begin_s) % over
        rise = np.clip(now_s / opened, 0, 1) - np.clip((now_s - stood) / (shut - stood), 0, 1)
        # How far it is open, 0 to 1; it starts and stops gently.
        share = 0.5 - 0.5 * np.cos(np.pi * rise)
        turn_deg = swing_deg * share + values["sway_deg"] * share * sway(t_s)
        along, ahead = draws.facing(values["heading_deg"] + turn_deg)
        position_m = hinge_m + up_m + out_m[:, None] * along[:, None]
        # A plate is brightest where it faces the radar.
        aspect = 0.1 + 0.9 * draws.lit(ahead[:, None], position_m, antenna_m) ** 4
        return Points(position_m, rcs_m2 * aspect)

    return Thing(draws.numbered("leaf", across.size), points)


def _plant(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a pot on a string: two swings of its own period, a twist, leaves without aspect."""
    string_m = values["string_m"]
    hook_m = np.array([*position_m, values["height_m"] + string_m])
    own_hz = np.sqrt(_GRAVITY / string_m) / (2 * np.pi)
    # Leaves and string make the two directions swing at slightly different rates.
    swing_hz, swing_turns = own_hz * (1 + 0.02 * rng.standard_normal(2)), rng.random(2)
    axis = rng.uniform(0, 2 * np.pi)
    strength = np.array([1.0, rng.uniform(0.1, 0.7)])
    strength /= np.linalg.norm(strength)
    turned = np.array([[np.cos(axis), np.sin(axis)], [-np.sin(axis), np.cos(axis)]])
    swing_m = values["amplitude_m"] * strength[:, None] * turned
    both = (draws.draw_gust(rng, 0.01, 0.1), draws.draw_gust(rng, 0.01, 0.1))
    away = rng.standard_normal((_N_LEAVES, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    out_m = values["radius_m"] * rng.uniform(0.4, 1.0, (_N_LEAVES, 1))
    x, y, z = np.vstack([np.zeros(3), out_m * away]).T
    twist_rad, twist_hz = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.4)
    flutter_hz, flutter_turns = rng.uniform(1.0, 4.0, _N_LEAVES + 1), rng.random(_N_LEAVES + 1)
    flutter_m = values["flutter_m"] * rng.random((_N_LEAVES + 1, 3))
    flutter_m[0] = 0.0
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, _N_LEAVES + 1)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        gusts = np.stack([g(t_s) for g in both], axis=1)
        turns = t_s[:, None] * swing_hz + swing_turns
        across_m = (np.sin(2 * np.pi * turns) * gusts) @ swing_m
        # The string stays as long as it is.
        down_m = np.sqrt(string_m**2 - (across_m**2).sum(axis=1))
        pot_m = hook_m + np.column_stack([across_m, -down_m])
        twist = twist_rad * np.sin(2 * np.pi * twist_hz * t_s)[:, None]
        cos, sin = np.cos(twist), np.sin(twist)
        leaf_m = np.stack([x * cos - y * sin, x * sin + y * cos, z + 0 * twist], axis=-1)
        flutter = np.sin(2 * np.pi * (t_s[:, None] * flutter_hz + flutter_turns))
        moved_m = flutter[..., None] * flutter_m * gusts[:, :1, None]
        return Points(pot_m[:, None] + leaf_m + moved_m, np.tile(rcs_m2, (len(t_s), 1)))

    return Thing(("pot", *draws.numbered("leaf", _N_LEAVES)), points)


def _rain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw tracks on a pane; on each, one drop after another runs down and then rests.

    A drop moves by ``s - b sin(2 pi m s) / (2 pi m)`` of its way with s even in time: it never
    runs up, and for b near 1 almost stops m times. A resting track has no cross section.
    """
    n = round(values["n_drops"])
    sill_m, height_m = np.array([*position_m, values["sill_m"]]), values["height_m"]
    right, _ = draws.facing(values["heading_deg"])
    run_s = height_m / (values["speed_mps"] * np.exp(0.5 * rng.standard_normal(n)))
    cycle_s = run_s * rng.uniform(1.1, 3.0, n)
    begin, track = rng.random((2, n))
    turn = 2 * np.pi * rng.integers(1, 6, n)
    sticky = rng.uniform(0.3, 0.98, n)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, n)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        number, now = np.divmod(t_s[:, None] / cycle_s + begin, 1.0)
        share = np.minimum(now * cycle_s / run_s, 1.0)
        fallen = share - sticky * np.sin(turn * share) / turn
        across = (track + _GOLDEN * number) % 1.0 - 0.5
        position_m = sill_m + (across * values["width_m"])[..., None] * right
        position_m[..., 2] += height_m * (1 - fallen)
        return Points(position_m, np.where(share < 1, rcs_m2, 0.0))

    return Thing(draws.numbered("drop", n), points)


def _fan(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw blades on a hub, behind a guard that stands still, on a head that may swing."""
    n_blades = round(values["n_blades"])
    pivot_m = np.array([*position_m, values["height_m"]])
    out_m = np.tile(values["radius_m"] * (np.arange(_PER_BLADE) + 1) / _PER_BLADE, n_blades)
    blade = np.repeat(np.arange(n_blades) / n_blades, _PER_BLADE)
    start, swing_turn = rng.random(), rng.random()
    # Real blades are not alike, else the comb would have no lines between.
    alike = 1 + 0.15 * rng.standard_normal(n_blades).clip(-2, 2)
    blades = np.repeat(alike, _PER_BLADE) * np.tile([0.6, 1.0, 1.4], n_blades)
    blade_rcs_m2 = 0.7 * values["rcs_m2"] * blades / blades.sum()
    still_rcs_m2 = 0.3 * values["rcs_m2"] * draws.shares(rng, 2)

    def points(t_s: Array, antenna_m: Array) -> Points:
        head = np.sin(2 * np.pi * (t_s / values["swing_s"] + swing_turn))
        right, ahead = draws.facing(values["heading_deg"] + values["swing_deg"] / 2 * head)
        turn = values["rotation_hz"] * t_s + start
        angle = 2 * np.pi * ((turn[:, None] + blade) % 1.0)
        cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
        along = cos * right[:, None] + sin * np.array([0.0, 0.0, 1.0])
        blade_m = pivot_m + out_m[:, None] * along
        guard_m = pivot_m + 0.1 * ahead[:, None]
        hub_m = np.broadcast_to(pivot_m, guard_m.shape)
        upright = 0.3 + 1.4 * np.sin(angle) ** 2
        aspect = upright * (1 - draws.lit(along, blade_m, antenna_m) ** 2) ** 2
        still = np.tile(still_rcs_m2, (len(t_s), 1))
        position_m = np.concatenate([hub_m, guard_m, blade_m], axis=1)
        return Points(position_m, np.concatenate([still, blade_rcs_m2 * aspect], axis=1))

    return Thing(("hub", "guard", *draws.numbered("blade point", blade.size)), points)


def drum(t_s: Array, spin_hz: float) -> tuple[Array, Array]:
    """Return a drum's rate in hertz and its turns so far, both of shape (n_slow,)."""
    ends_s = np.cumsum([_TUMBLE_S, _RAMP_S, _SPIN_S, _RAMP_S])
    cycle, now_s = np.divmod(t_s, ends_s[-1])
    up_s = np.clip(now_s - ends_s[0], 0, _RAMP_S)
    down_s = np.clip(now_s - ends_s[2], 0, _RAMP_S)
    rise = (spin_hz - _TUMBLE_HZ) / _RAMP_S
    hz = _TUMBLE_HZ + rise * (up_s - down_s)
    level_s = np.clip(now_s - ends_s[1], 0, None)
    ramps = rise * (up_s**2 / 2 + _RAMP_S * level_s - down_s**2 / 2)
    in_cycle = _TUMBLE_HZ * ends_s[-1] + rise * _RAMP_S * (_RAMP_S + _SPIN_S)
    return hz, np.asarray(_TUMBLE_HZ * now_s + ramps + cycle * in_cycle)


def _washing_machine(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a box that shakes, through the resonance of a mass on springs."""
    across, up = draws.grid(values["width_m"], values["height_m"], 3, 4)
    n = across.size
    right, ahead = draws.facing(values["heading_deg"])
    rest_m = across[:, None] * right + np.array([*position_m, 0.0])
    rest_m[:, 2] += up
    begin_s = rng.uniform(0, _TUMBLE_S + 2 * _RAMP_S + _SPIN_S)
    # Feet on the floor: it rocks, so the top moves most; each point a little otherwise.
    shape = (0.2 + 0.8 * up / values["height_m"])[:, None] * (
        rng.uniform(0.5, 1.0) * ahead
        + rng.uniform(0.2, 0.6) * right
        + 0.1 * rng.standard_normal((n, 3))
    )
    lag_turns = 0.1 * rng.random(n)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, n)

    def points(t_s: Array, antenna_m: Array) -> Points:
        hz, turns = drum(t_s + begin_s, values["spin_hz"])
        ratio = (hz / values["resonance_hz"]) ** 2
        answer = ratio / np.sqrt((1 - ratio) ** 2 + 4 * _DAMPING**2 * ratio)
        # The greatest answer of this damping is 2.55; the amplitude is that of the peak.
        swing_m = values["amplitude_m"] * (0.1 + 0.9 * answer / 2.55)
        wave = np.sin(2 * np.pi * ((turns[:, None] + lag_turns) % 1.0))
        position_m = rest_m + (swing_m[:, None] * wave)[..., None] * shape
        aspect = 0.3 + 0.7 * draws.lit(ahead, position_m, antenna_m) ** 4
        return Points(position_m, rcs_m2 * aspect)

    return Thing(draws.numbered("front", n), points)


def _vacuum(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a flat disc with a side brush; its way of ten minutes ends where it began."""
    radius_m, brush_hz, total_m2 = values["radius_m"], values["brush_hz"], values["rcs_m2"]
    low_m, top_m = np.array([[0, 0, values["height_m"] / 2], [0, 0, values["height_m"]]])
    knot_s, x_m, y_m, turn_deg, bump_s = _drive(rng, values["area_m"] / 2, values["speed_mps"])
    home_m, begin_s = np.array([*position_m, 0.0]), rng.uniform(0, _LOOP_S)
    shake_hz = rng.uniform(6, 12)
    rim_deg = 360 * (np.arange(_N_RIM) + 0.3 * rng.random(_N_RIM)) / _N_RIM
    rim_rcs_m2 = 0.8 * values["rcs_m2"] * draws.shares(rng, _N_RIM)

    def points(t_s: Array, antenna_m: Array) -> Points:
        now_s = (t_s + begin_s) % knot_s[-1]
        heading_deg = np.interp(now_s, knot_s, turn_deg)
        _, ahead = draws.facing(heading_deg)
        x, y = np.interp(now_s, knot_s, x_m), np.interp(now_s, knot_s, y_m)
        place_m = np.column_stack([x, y, 0 * now_s])
        # After a bump the body rings on its wheels for a tenth of a second.
        since_s = now_s - bump_s[np.searchsorted(bump_s, now_s, side="right") - 1]
        ring_m = np.exp(-since_s / 0.1) * np.sin(2 * np.pi * shake_hz * since_s)
        middle_m = home_m + place_m + values["bump_m"] * ring_m[:, None] * ahead
        _, outward = draws.facing(heading_deg[:, None] + rim_deg)
        rim_m = middle_m[:, None] + radius_m * outward + low_m
        brush_m = middle_m + 0.8 * radius_m * draws.facing(heading_deg + 45)[1]
        angle_deg = 360 * ((brush_hz * t_s) % 1.0)[:, None] + np.arange(_BRISTLES) * 120
        bristle_m = brush_m[:, None] + 0.09 * draws.facing(angle_deg)[1] + 0.1 * low_m
        bright = np.maximum(draws.lit(outward, rim_m, antenna_m), 0.05)
        top, bristle = np.ones((len(t_s), 1)), np.ones((len(t_s), _BRISTLES)) / _BRISTLES
        parts_m = [(middle_m + top_m)[:, None], rim_m, bristle_m]
        parts_m2 = [0.15 * total_m2 * top, rim_rcs_m2 * bright, 0.05 * total_m2 * bristle]
        return Points(np.concatenate(parts_m, axis=1), np.concatenate(parts_m2, axis=1))

    names = ("top", *draws.numbered("rim", _N_RIM), *draws.numbered("bristle", _BRISTLES))
    return Thing(names, points)


def _drive(
    rng: np.random.Generator, half_m: float, speed_mps: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Return a closed way inside a square: times, x, y and heading of its knots, bump times."""
    x, y = rng.uniform(-half_m, half_m, 2)
    heading = rng.uniform(0, 360)
    knots = [(0.0, x, y, heading)]
    bumps = [-1e3]
    home, first = (x, y), heading

    # A run or a turn of nothing still takes a moment, so times go up.
    def run(goal: tuple[float, float], speed_mps: float) -> None:
        t, x, y, at_deg = knots[-1]
        took_s = max(np.hypot(goal[0] - x, goal[1] - y) / speed_mps, 1e-3)
        knots.append((t + took_s, *goal, at_deg))

    def turn(goal_deg: float) -> None:
        t, x, y, at_deg = knots[-1]
        knots.append((t + max(abs(goal_deg - at_deg) / _TURN_DEG_PER_S, 1e-3), x, y, goal_deg))

    while knots[-1][0] < _LOOP_S:
        goal = _straight(x, y, heading, half_m)
        run(goal, speed_mps)
        bumps.append(knots[-1][0])
        away = np.deg2rad(heading)
        x, y = goal[0] - _BACK_M * np.sin(away), goal[1] - _BACK_M * np.cos(away)
        run((x, y), _BACK_MPS)
        # Off the wall, and never straight back into it.
        heading += rng.uniform(70, 170) * (1 if rng.random() < 0.5 else -1)
        turn(heading)
    at = knots[-1]
    heading = float(np.rad2deg(np.arctan2(home[0] - at[1], home[1] - at[2])))
    heading += 360 * round((at[3] - heading) / 360)
    turn(heading)
    run(home, speed_mps)
    turn(first + 360 * round((heading - first) / 360))
    t_s, x_m, y_m, turn_deg = np.array(knots).T
    return t_s, x_m, y_m, turn_deg, np.array(bumps)


def _straight(x: float, y: float, heading_deg: float, half_m: float) -> tuple[float, float]:
    """Return where a straight run meets the square's side."""
    across, along = np.sin(np.deg2rad(heading_deg)), np.cos(np.deg2rad(heading_deg))
    ways = [
        (np.copysign(half_m, step) - at) / step
        for at, step in ((x, across), (y, along))
        if abs(step) > 1e-9
    ]
    way = max(min(ways), 0.0)
    return x + way * across, y + way * along


_CURTAIN = {
    "heading_deg": draws.TOWARDS,
    "width_m": Draw(0.2, 6, (0.8, 2.5), "width, m"),
    "height_m": Draw(0.2, 4, (1.2, 2.3), "height, m"),
    "floor_gap_m": Draw(0, 3, (0.02, 0.8), "from floor to hem, m"),
    "frequency_hz": Draw(0.05, 3, (0.2, 1.1), "main wave, Hz"),
    "amplitude_m": Draw(0, 0.3, (0.01, 0.06), "greatest swing of the hem, m"),
    "rcs_m2": draws.RCS,
}
_FAN = {
    "heading_deg": draws.HEADING,
    "height_m": Draw(0, 5, (0.4, 1.4), "of the hub above the floor, m"),
    "radius_m": Draw(0.02, 1.5, (0.1, 0.25), "of the blades, m"),
    "n_blades": Draw(1, 12, (2.51, 6.49), "blades, rounded"),
    "rotation_hz": Draw(0.1, 60, (1, 25), "turns per second, Hz", is_log=True),
    "swing_deg": Draw(0, 180, (0, 90), "from end to end of the head's swing, degrees"),
    "swing_s": Draw(2, 120, (8, 20), "period of the head's swing, s"),
    "rcs_m2": draws.RCS,
}
_VACUUM = {
    "speed_mps": Draw(0.01, 1, (0.2, 0.35), "of its runs, m/s"),
    "area_m": Draw(0.2, 20, (1.2, 3.0), "side of the square it cleans, m"),
    "radius_m": Draw(0.05, 0.5, (0.16, 0.18), "of its body, m"),
    "height_m": Draw(0.02, 0.5, (0.08, 0.1), "of its body, m"),
    "brush_hz": Draw(0, 20, (1.5, 4), "turns per second of its side brush, Hz"),
    "bump_m": Draw(0, 0.02, (0.001, 0.005), "how far it rings after a bump, m"),
    "rcs_m2": draws.RCS,
}
_WASHING_MACHINE = {
    "heading_deg": draws.TOWARDS,
    "width_m": Draw(0.2, 2, (0.4, 0.6), "width, m"),
    "height_m": Draw(0.2, 2, (0.82, 0.9), "height, m"),
    "spin_hz": Draw(1, 40, (8, 20), "rate of the spin, Hz"),
    "resonance_hz": Draw(0.5, 30, (3, 7), "of the drum on its springs, Hz"),
    "amplitude_m": Draw(0, 0.02, (0.0005, 0.004), "greatest swing, m"),
    "rcs_m2": draws.RCS,
}
_DOOR = {
    "heading_deg": draws.TOWARDS,
    "width_m": Draw(0.2, 2, (0.6, 0.9), "width of the leaf, m"),
    "height_m": Draw(0.2, 3, (1.9, 2.1), "height, m"),
    "swing_deg": Draw(0, 180, (15, 100), "from shut to open, degrees"),
    "move_s": Draw(0.3, 60, (1.0, 4.0), "time to open, s"),
    "rest_s": Draw(0, 3600, (0.5, 6.0), "time it stands open, and shut, s"),
    "sway_deg": Draw(0, 20, (0, 4), "to and fro while open, degrees"),
    "rcs_m2": draws.RCS,
}
_PLANT = {
    "height_m": Draw(0, 5, (1.2, 2.0), "of the pot above the floor, m"),
    "string_m": Draw(0.2, 5, (0.3, 1.0), "from hook to pot, m"),
    "radius_m": Draw(0.01, 1, (0.1, 0.25), "of the leaves, m"),
    "amplitude_m": Draw(0, 0.15, (0.01, 0.08), "greatest swing, m"),
    "flutter_m": Draw(0, 0.05, (0, 0.006), "greatest tremble of a leaf, m"),
    "rcs_m2": draws.RCS,
}
_RAIN = {
    "heading_deg": draws.TOWARDS,
    "width_m": Draw(0.1, 6, (0.6, 1.5), "of the pane, m"),
    "height_m": Draw(0.1, 4, (0.6, 1.4), "of the pane, m"),
    "sill_m": Draw(0, 5, (0.7, 1.1), "of its lower edge above the floor, m"),
    "n_drops": Draw(1, 200, (12, 40), "tracks, rounded"),
    "speed_mps": Draw(0.001, 2, (0.02, 0.3), "mean of a drop, m/s", is_log=True),
    "rcs_m2": Draw(1e-9, 1, (1e-4, 1e-2), "of all drops together, m2", is_log=True),
}
THINGS: Mapping[str, ThingKind] = {
    "curtain": ThingKind(_CURTAIN, _curtain),
    "fan": ThingKind(_FAN, _fan),
    "robot_vacuum": ThingKind(_VACUUM, _vacuum),
    "washing_machine": ThingKind(_WASHING_MACHINE, _washing_machine),
    "door": ThingKind(_DOOR, _door),
    "plant": ThingKind(_PLANT, _plant),
    "rain": ThingKind(_RAIN, _rain),
}
"""Kinds of things by name, with the numbers of each."""


def draw_thing(
    rng: np.random.Generator, kind: str, position_m: Any, raw: Any = None, where: str = "thing"
) -> Mover:
    """Return a thing of `THINGS` that moves in its place on the floor, [x, y]; or SceneError."""
    thing = THINGS[kind]
    place = np.array(place_of(position_m, f"{where}.position_m"))
    return thing.make(rng, place, values_of(rng, thing.draws, raw, where))
