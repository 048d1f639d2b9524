"""A folder of clips as bodies: any skin, sizes and tempos, the same again by seed."""

import numpy as np
import pytest

from tests.training.motion_helpers import stander, walker, write_clip
from x2radar.sim.bodies.skins.draw import SKINS
from x2train.cli import main
from x2train.motion.library import cards_of, draw_recorded_body, read_library
from x2train.sets.families import CLIPS, draw_cast, recorded_families
from x2train.sets.shards import read_all

T_S = np.arange(0.0, 6.0, 1 / 60)
ANTENNA_M = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("library")
    write_clip(made / "walk.npz", walker(), "person", "anna", licence="CC0", source="made here")
    write_clip(made / "stand.npz", stander(), "quadruped", "rex")
    write_clip(made / "rex_death.npz", stander(), "quadruped", "rex", action="death")
    return made


def test_individuals_go_or_stay_and_nobody_dies(folder):
    anna, rex = read_library(folder)
    assert (anna.name, anna.label, anna.goes) == ("anna goes", "human", True)
    assert (rex.name, rex.label, rex.goes) == ("rex stays", "pet", False)
    assert [clip.name for clip in rex.clips] == ["stand"]
    # What was recorded of an animal counts more than what is animated.
    assert rex.weight > anna.weight
    rows = cards_of([anna, rex])
    assert [(row["clip"], len(row["sha256"])) for row in rows] == [("walk", 64), ("stand", 64)]
    assert rows[0]["licence"] == "CC0"
    # Casts are of the folder, and things stay simulated.
    rng, use = np.random.default_rng(0), f"{CLIPS}{folder}"
    assert [f.name for f in recorded_families(str(folder))] == ["anna goes", "rex stays"]
    (who,), (pet,), (thing,) = (draw_cast(rng, label, use) for label in ("human", "pet", "other"))
    assert (who.name, who.stays, pet.name, pet.stays) == ("anna goes", False, "rex stays", True)
    assert thing.plugged is None


@pytest.mark.parametrize("skin", SKINS)
@pytest.mark.parametrize("who", [0, 1])
def test_bodies_echo_through_every_skin(folder, skin, who):
    individual = read_library(folder)[who]
    options = {"skin": skin, "near_m": 0.6, "far_m": 3.4}
    for seed in range(3):
        one, two = (
            draw_recorded_body(individual, np.random.default_rng(seed), options, "here")
            for _ in range(2)
        )
        assert one.label == individual.label
        points, again = one.at(T_S, ANTENNA_M), two.at(T_S, ANTENNA_M)
        np.testing.assert_array_equal(points.position_m, again.position_m)
        assert points.position_m.shape == (len(T_S), len(one.names), 3)
        assert np.isfinite(points.rcs_m2).all()
        assert (points.rcs_m2 >= 0).all()
        height = points.position_m[..., 2].max()
        assert height < (2.1 if who == 0 else 1.0)


@pytest.mark.integration
def test_a_set_of_recorded_motion_is_the_same_for_any_number_of_workers(folder, tmp_path, capsys):
    words = ["dataset", "--clips", str(folder), "--passages", "6", "--radar", "x2"]
    for n in ("1", "2"):
        assert main([*words, "--workers", n, "--out", str(tmp_path / n)]) == 0
    (_, one), (_, two) = (read_all(tmp_path / n) for n in ("1", "2"))
    np.testing.assert_equal(one, two)
    (tmp_path / "none").mkdir()
    assert (
        main(["dataset", "--clips", str(tmp_path / "none"), "--out", str(tmp_path / "set")]) == 66
    )
    assert "no clips" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()
