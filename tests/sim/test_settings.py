"""What a scene says about room, antenna, surfaces, receiver, things and places is judged."""

import math
from dataclasses import fields
from functools import partial

import numpy as np
import pytest

from x2radar.errors import SceneError, SettingsError
from x2radar.keys import settings_from
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.place.multipath import Surface, TailSettings
from x2radar.sim.place.room import RoomSettings
from x2radar.sim.signal.effects import ReceiverEffects
from x2radar.sim.things import THINGS, draw_mount, draw_thing
from x2radar.sim.things.draws import DRAWS

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
        ("curtian", PLACE, None, r"curtian: no such thing; did you mean cur"),
        ("door", PLACE, {"widht_m": 1}, r"widht_m: unknown key; did you mean width_m\?"),
        ("door", "here", None, "position_m: must be 2 numbers"),
        ("door", (1, 2, 3), None, "position_m: must be 2 numbers"),
        ("door", None, None, "position_m: must be 2 numbers"),
        ("door", (1, math.nan), None, r"position_m\[1\]: nan is not in"),
        ("door", (-1000, 1), None, r"position_m\[0\]: -1000 is not in"),
        ("door", ("x", 1), None, r"position_m\[0\]: must be a number"),
    ],
)
def test_names_and_places_of_things(kind, place, said, words):
    with pytest.raises(SceneError, match=rf"^thing\.{words}"):
        draw_thing(np.random.default_rng(0), kind, place, said)
