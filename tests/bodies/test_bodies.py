"""What holds for all that moves, whatever it is, whatever it does, whatever moves it."""

from functools import cache

import numpy as np
import pytest

from tests.body_helpers import ANTENNA_M, PEOPLE, PETS, WAYS, draw, drawn, past, speeds
from x2radar.errors import SceneError
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.motion.people.gait import STYLES
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.bodies.skins import SKINS
from x2radar.sim.points import Pose
from x2radar.sim.things.draws import draw_mount
from x2radar.sim.things.kinds import THINGS, draw_thing

GOERS = [("human", "walk"), ("human", "run"), ("human", "carry"), ("dog", "walk"), ("cat", "trot")]
EVERY = [
    *((*way, "gait", "surface") for way in WAYS),
    *((*way, motion, skin) for way in GOERS for motion in MOTIONS for skin in SKINS),
]
"""Everything that bodies do by the first motion and skin, and those that go by all of them."""


MOVERS = [*EVERY, *((kind,) for kind in sorted(THINGS))]


def mover_of(way, seed=3):
    """A body that goes its way, or a thing."""
    if len(way) == 1:
        return draw_thing(np.random.default_rng(seed), *way, (0.3, 2.0))
    kind, style, motion, skin = way
    options = {"motion": motion} if kind == "human" or kind in SPECIES else {}
    return draw(kind, style, seed, skin=skin, **options)


mover_once = cache(mover_of)


def mean_m2(body, t_s):
    pose = body.motion(t_s)
    side = np.broadcast_to(pose.side, pose.axis.shape)
    return body.skin.mean_total_m2(Pose(pose.centre_m, pose.axis, side))


@pytest.mark.parametrize("way", MOVERS, ids=" ".join)
def test_points_are_what_a_mover_gives_whenever_they_are_asked_for(way):
    mover, is_body = mover_once(way), len(way) > 1
    t_s = np.random.default_rng(1).uniform(-2, 60, 40) * (1 if is_body else 80)
    whole = mover.at(t_s, ANTENNA_M)
    shape = (40, len(mover.names))
    assert is_body or len(set(mover.names)) == len(mover.names)
    assert whole.position_m.shape == (*shape, 3)
    assert whole.rcs_m2.shape == shape
    assert whole.nearer_m is None or whole.nearer_m.shape == shape
    assert np.isfinite(whole.position_m).all()
    assert whole.position_m[..., 2].min() > -0.05
    assert (whole.rcs_m2 >= 0).all()
    assert whole.rcs_m2.any()
    labels = dict.fromkeys(("moth", *THINGS), "other") | {"human": "human"}
    assert mover.label == labels.get(way[0], "pet")
    assert mover.at(t_s[:0], ANTENNA_M).rcs_m2.shape == (0, shape[1])
    # One seed is one mover, and it has no state: any times in any order, together or alone.
    for other, order in ((mover_of(way), slice(None, None, -1)), (mover, slice(17, 18))):
        points = other.at(t_s[order], ANTENNA_M)
        assert points.position_m == pytest.approx(whole.position_m[order], abs=1e-9)
        near = {"rel": 1e-4} if is_body else {"rel": 1e-9, "abs": 1e-15}
        assert points.rcs_m2 == pytest.approx(whole.rcs_m2[order], **near)
    another = mover_of(way, 4).at(t_s, ANTENNA_M)
    if another.position_m.shape == whole.position_m.shape:
        assert np.abs(another.position_m - whole.position_m).max() > 1e-3


# In what is done without going.
FASTEST_HANDS_MPS = {"": 0.7, "busy": 3.0, "sit": 3.0, "exercise": 8.0}


@pytest.mark.parametrize(("kind", "style"), WAYS)
def test_nothing_jumps_is_too_fast_or_goes_through_the_floor(kind, style):
    body = drawn(kind, style, 1)
    step_s = 1e-4 if (kind, style) not in PEOPLE + PETS else 1e-3
    t_s = np.concatenate([np.arange(1000) * step_s + start_s for start_s in (0.0, 2.0, 5.0)])
    points = body.at(t_s, ANTENNA_M)
    within = np.diff(t_s) < 2 * step_s
    speed = speeds(points.position_m, step_s)[within]
    assert points.position_m[..., 2].min() > (-0.02 if kind == "human" else 0.0)
    if kind == "human":
        fastest = body.motion.path.cruise_mps if hasattr(body.motion, "path") else 1.5
        assert speed.max() <= 4.5 * fastest + FASTEST_HANDS_MPS[STYLES[style].does]
    else:
        assert speed.max() < (12 if kind in SPECIES else 20)
    if kind in SPECIES:
        assert np.abs(np.diff(speed, axis=0)).max() < 12
        assert np.quantile(np.abs(np.diff(speed, axis=0)), 0.999) < 0.8  # 80 g, at a knee
    # A leg ten times as long as thick flashes by in some milliseconds.
    assert np.abs(np.diff(np.log(points.rcs_m2), axis=0)[within]).max() < 0.8


LIMBS = {
    "human": [("left thigh", "left shank"), ("right upper arm", "right forearm")],
    "dog": [(f"{leg} upper leg", f"{leg} lower leg") for leg in ("left hind", "right fore")],
}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(
    ("kind", "style"),
    [*((k, s) for k, s in PEOPLE if s != "crawl"), ("dog", "walk"), ("dog", "play")],
)
def test_bones_keep_their_lengths_and_limbs_join(kind, style, motion):
    body = drawn(kind, style, 3, path=((0.0, 9.0), (0.0, 1.0)), motion=motion)
    pose = body.motion(np.linspace(0, 12, 300))
    assert np.linalg.norm(pose.axis, axis=-1) == pytest.approx(1, abs=0.02)
    half = body.skin.half_m[:, 0]
    for pair in LIMBS[kind]:
        upper, lower = (body.names.index(name) for name in pair)
        ends = [
            pose.centre_m[:, k, None]
            + np.array([-1, 1])[:, None] * half[k] * pose.axis[:, k, None]
            for k in (upper, lower)
        ]
        # The nearest ends of both are one joint.
        gaps = np.linalg.norm(ends[0][:, :, None] - ends[1][:, None], axis=-1)
        assert gaps.min(axis=(1, 2)).max() < 0.02


@pytest.mark.parametrize(
    ("kind", "style", "options", "least_m2", "most_m2"),
    [
        ("human", "walk", {"height_m": 1.75}, 0.3, 1.6),
        ("cat", "roam", {"mass_kg": 4.0}, 0.02, 0.09),
        ("cat", "lie", {"mass_kg": 6.5}, 0.02, 0.09),
        ("dog", "roam", {"mass_kg": 20.0}, 0.08, 0.35),
        ("dog", "sit", {"mass_kg": 20.0}, 0.08, 0.35),
        ("rabbit", "roam", {"mass_kg": 2.0}, 0.01, 0.04),
        ("budgerigar", "circle", {}, 10**-3.2, 10**-2.2),
        ("pigeon", "circle", {}, 10**-2.6, 10**-1.7),
        ("moth", "", {}, 10**-4.2, 10**-2.9),
    ],
)
def test_physical_totals_are_those_of_the_kind(kind, style, options, least_m2, most_m2):
    for seed in range(3):
        body = draw(kind, style, seed, total_rcs_dbsm="physical", **options)
        assert body.skin.scale == 1
        assert least_m2 < mean_m2(body, np.linspace(0, 12, 12)) < most_m2


@pytest.mark.parametrize(
    ("kind", "options", "said"),
    [
        ("human", {"style": "moonwalk"}, "style: must be one of walk, stroll, .* not 'moonwalk'"),
        ("human", {"height_m": 3.0}, "height_m: 3.0 is not in 0.6 to 2.3"),
        ("human", {"speed_mps": 9.0}, "speed_mps: 9 m/s is too fast to walk"),
        ("human", {"motion": "ballet"}, "motion: must be one of gait"),
        ("human", {"skin": "fur"}, "skin: must be one of surface, points"),
        ("human", {"total_rcs_dbsm": 99.0}, "total_rcs_dbsm"),
        ("dog", {"mass_kg": 0.5}, "mass_kg: 0.5 is not in 1 to 100"),
        ("dog", {"style": "walk", "path": past(4.0)}, "path: 4 m/s is too fast for a dog"),
        ("dog", {"style": "roam", "path": [(0.0, 1.0), (0.0, 1.05)]}, "waypoints_m"),
        ("dragon", {}, "species: must be one of budgerigar"),
    ],
)
def test_what_is_impossible_is_refused_in_one_line(kind, options, said):
    with pytest.raises(SceneError, match=said):
        draw(kind, **options)


T_S = np.arange(0, 20, 0.02)


def figures_of(position_m, rcs_m2):
    """Where points are and how far they go, how fast and how strong they are, to four digits."""
    middle_m = position_m.mean(axis=1)
    total_m2 = np.maximum(rcs_m2.sum(axis=1), 1e-9)
    found = {
        "middle_m": middle_m.mean(axis=0),
        "sway_m": middle_m.std(axis=0),
        "parts_m": position_m.std(axis=(0, 1)),
        "speed_mps": np.quantile(speeds(position_m, T_S[1]), [0.1, 0.5, 0.9, 1]),
        "strength_db": 10 * np.log10(np.quantile(total_m2, [0.05, 0.5, 0.95])),
    }
    return {key: [float(f"{x:.4g}") for x in values] for key, values in found.items()}


def test_everything_that_moves_does_so_as_before(golden):
    """As kept in tests/data; `./test --renew` keeps today's."""
    made = []
    for way in MOVERS:
        points = mover_once(way).at(T_S, ANTENNA_M)
        name = " ".join(filter(None, way))
        made.append({"name": name, **figures_of(points.position_m, points.rcs_m2)})
    offset_m = draw_mount(np.random.default_rng(3), {})(T_S)[:, None]
    made.append({"name": "mount", **figures_of(offset_m, np.ones((len(T_S), 1)))})
    for now, before in zip(made, golden("movers.jsonl", made), strict=True):
        assert now["name"] == before["name"]
        for key in set(now) - {"name"}:
            assert now[key] == pytest.approx(before[key], rel=0.01, abs=1e-6), (now["name"], key)
