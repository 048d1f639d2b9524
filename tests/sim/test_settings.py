"""Numbers of a scene, of its things and of their places: what they may be, and at their ends."""

import math
from dataclasses import fields
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.errors import SceneError, SettingsError
from x2radar.keys import settings_from
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.place.multipath import Surface, TailSettings
from x2radar.sim.place.room import RoomSettings
from x2radar.sim.signal.receiver import ReceiverEffects
from x2radar.sim.things.draws import DRAWS, draw_mount
from x2radar.sim.things.kinds import THINGS, draw_thing

CLASSES = (Antenna, Surface, TailSettings, RoomSettings, ReceiverEffects)
FIELDS = [(cls, field.name, field.metadata["key"]) for cls in CLASSES for field in fields(cls)]
PLACE = (0.3, 2.0)


def wrong_values(low, high):
    step = 1e-3 * max(abs(low), abs(high), 1e-3)
    return [low - step, high + step, math.nan, math.inf, 10**400, "loud", True, [1]]


@pytest.mark.parametrize(("cls", "name", "key"), FIELDS)
def test_what_no_setting_may_be_is_named_in_code_and_in_a_scene(cls, name, key):
    wrong = ["pink", 7, None] if key.choices else wrong_values(key.low, key.high)
    wrong += [key.low + 0.5] if key.is_whole else []
    for value in wrong:
        with pytest.raises(SettingsError, match=f"^{name} = ") as code:
            cls(**{name: value})
        with pytest.raises(SceneError, match=rf"^x.yaml: part\.{name}: ") as scene:
            settings_from(cls, {name: value}, "x.yaml: part")
        assert "\n" not in str(code.value) + str(scene.value)
    for value in [*key.choices] or [key.low, key.high]:
        if (cls, name) != (TailSettings, "free_m") and (cls, name, value) != (
            TailSettings,
            "reach_m",
            key.low,
        ):
            assert getattr(settings_from(cls, {name: value}, ""), name) == value
    if key.is_optional:
        assert getattr(settings_from(cls, {name: None}, ""), name) is None


def test_all_faults_at_once_unknown_keys_and_nothing():
    with pytest.raises(SettingsError, match=r"jitter_s = .*; lost_share = "):
        ReceiverEffects(jitter_s=-1, lost_share=2)
    with pytest.raises(
        SceneError, match=r"^receiver\.jiter_s: unknown key; did you mean jitter_s"
    ):
        settings_from(ReceiverEffects, {"jiter_s": 0}, "receiver")
    with pytest.raises(SceneError, match=r"^receiver: must be a mapping"):
        settings_from(ReceiverEffects, [1], "receiver")
    assert settings_from(ReceiverEffects, None, "receiver") == ReceiverEffects()


NUMBERS = [(kind, name) for kind, thing in THINGS.items() for name in thing.draws]


@pytest.mark.parametrize(("kind", "name"), [*NUMBERS, *(("mount", name) for name in DRAWS)])
def test_what_no_number_of_a_thing_may_be_is_named_with_its_path(kind, name):
    rng = np.random.default_rng(0)
    make = partial(draw_mount, rng) if kind == "mount" else partial(draw_thing, rng, kind, PLACE)
    limits = DRAWS[name] if kind == "mount" else THINGS[kind].draws[name]
    assert limits.low <= limits.usual[0] <= limits.usual[1] <= limits.high
    for value in [*wrong_values(limits.low, limits.high), None]:
        with pytest.raises(SceneError, match=rf"^a.yaml: it\.{name}: ") as caught:
            make({name: value}, "a.yaml: it")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "place", "said", "words"),
    [
        ("door", PLACE, {"widht_m": 1}, r"widht_m: unknown key; did you mean width_m\?"),
        ("door", "here", None, "position_m: must be 2 numbers"),
        ("door", (1, 2, 3), None, "position_m: must be 2 numbers"),
        ("door", None, None, "position_m: must be 2 numbers"),
        ("door", (1, math.nan), None, r"position_m\[1\]: nan is not in"),
        ("door", (-1000, 1), None, r"position_m\[0\]: -1000 is not in"),
        ("door", ("x", 1), None, r"position_m\[0\]: must be a number"),
    ],
)
def test_keys_and_places_of_things(kind, place, said, words):
    with pytest.raises(SceneError, match=rf"^thing\.{words}"):
        draw_thing(np.random.default_rng(0), kind, place, said)


HERE = np.array([0.0, 0.0, 1.5])
KINDS = sorted(THINGS)


def thing(kind, seed=0, **said):
    return draw_thing(np.random.default_rng(seed), kind, PLACE, said, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_both_ends_of_every_number_work(kind):
    for end in ("low", "high"):
        said = {name: getattr(d, end) for name, d in THINGS[kind].draws.items()}
        p = thing(kind, **said).at(np.linspace(0, 20, 40), HERE)
        assert np.isfinite(p.position_m).all()
        assert np.isfinite(p.rcs_m2).all()
        assert (p.rcs_m2 >= 0).all()


@settings(max_examples=40)
@given(st.sampled_from(KINDS), st.integers(0, 2**32), st.floats(0, 1e6))
def test_nothing_jumps(kind, seed, begin_s):
    """Half a millisecond moves no point further than the fastest blade."""
    ours = thing(kind, seed)
    t_s = begin_s + np.arange(100) * 5e-4
    step_m = np.linalg.norm(np.diff(ours.at(t_s, HERE).position_m, axis=0), axis=-1)
    seen = ours.at(t_s, HERE).rcs_m2
    step_m = step_m[(seen[1:] > 0) & (seen[:-1] > 0)]
    fastest_mps = 2 * np.pi * 25 * 0.25 if kind == "fan" else 3.0
    assert step_m.max(initial=0.0) < fastest_mps * 5e-4 * 1.05


def test_fan_blades_turn_on_circles_and_make_a_comb():
    t_s = np.arange(0, 4, 1 / 400)
    said = {"rotation_hz": 5.0, "n_blades": 3, "radius_m": 0.2, "swing_deg": 0}
    p = thing("fan", heading_deg=120, **said).at(t_s, HERE)
    hub, tip = p.position_m[:, 0], p.position_m[:, 2 + 2]
    assert np.linalg.norm(tip - hub, axis=1) == pytest.approx(np.full(t_s.size, 0.2))
    assert np.ptp(hub, axis=0).max() == 0
    rows = Antenna(shape="isotropic").direct(p)
    track = (rows.root_rcs_m * np.exp(-2j * np.pi * 2 * rows.range_m / 0.0441)).sum(axis=1)
    power = np.abs(np.fft.fft((track - track.mean()) * np.hanning(t_s.size))) ** 2
    hz = np.fft.fftfreq(t_s.size, 1 / 400)
    on_comb = np.abs((np.abs(hz) + 2.5) % 5 - 2.5) < 0.6
    assert power[on_comb].sum() > 0.95 * power.sum()
    assert np.count_nonzero(power[on_comb] > power.max() / 100) > 10


def mount(seed=0, **said):
    return draw_mount(np.random.default_rng(seed), said)


def test_mount_has_no_state_and_obeys_its_seed():
    t_s = np.random.default_rng(0).uniform(0, 1e4, 100)
    whole = mount(3)(t_s)
    assert mount(3)(t_s[::-1])[::-1] == pytest.approx(whole, abs=1e-15)
    assert not np.array_equal(mount(4)(t_s), whole)
    limit = sum(DRAWS[k].usual[1] for k in ("hum_m", "sway_m", "shock_m", "shock_m"))
    assert np.linalg.norm(whole, axis=1).max() <= limit
    still = mount(hum_m=0, sway_m=0, shock_m=0)(t_s)
    assert not still.any()
