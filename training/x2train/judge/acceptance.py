"""The acceptance test of a product: what a buyer asks of an alarm, entry by entry.

Two radars (X2, X4M03) at three mounts, bodies whose cross sections follow from their sizes, every
motion and skin. Passage k of an entry is the same for every bundle; results of different versions
are not compared. Walk tests are modelled on EN 50131-2-3, no more. With a folder of clips it is
recorded people and animals who come: those alone of whom the bundle has learned nothing.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.config.sections import AUTO_MODEL
from radard.errors import ModelMismatch, UsageError
from radard.judge.bundle import load_bundle, sidecar_path
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins import SKINS
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.scene.scene import SceneStep
from x2train.judge.judging import Knows, dwells, from_decisions, in_view, installed, pipeline_for
from x2train.judge.suites import SUITES
from x2train.judge.table import PassageTable
from x2train.motion.library import cards_of, read_library
from x2train.sets.families import Family, families, family, recorded_families
from x2train.sets.passages import BodyModel, Player, actor, play
from x2train.sets.shards import make_shards
from x2train.sets.sites import X2, X4M03, Radar, Site, draw_site
from x2train.sets.windows import GATE
from x2train.sets.workers import Crew

VERSION = "accept-3"  # of entries, settings, seed (test_accept.py) and bodies
_RECORDED_VERSION = "accept-4"  # the same, of recorded bodies
SEED = 90  # passages of the version are drawn from it; of no other suite
_TOLD = 1  # a generator's number: what an installation is told changes no passage
_PER_SHARD = 60  # passages: a minute of one core
Kind = Literal["walk test", "pets cross", "pets stay", "thing"]
_N_ENTRIES = 300  # none of so many passages means less than 1.2 % at 95 %
_N_STAYS = 12  # of each stay: seven hours
_STAY_S = (600.0, 3600.0)
_THING_S = 600.0
_N_THINGS = 6  # an hour of each, ten minutes in every setting
_VISIT_S = 20.0  # a pet that crosses: as in the stress suites
_WALK_S = 14.0  # recorded people: as walk tests are
_LEAD_S = (2.6, 4.0)
_LEVEL_DB = 2.0  # radars differ by so much either way
_BEAM_DEG = 65.0  # of the X2's antenna, by its data sheet


@dataclass(frozen=True, slots=True)
class Setting:
    """A radar and how it hangs; bodies go up to `far_m` from the point below it."""

    radar: Radar
    mount: str
    height_m: float
    tilt_deg: float
    far_m: float

    @property
    def name(self) -> str:
        """Radar and mount, as reports name them."""
        return f"{self.radar.name}, {self.mount}"


# Radars and mounts, in turn. The third kind is in no training: chosen for that. What is claimed to
# be covered is what the beam and the swath leave on the floor.
SETTINGS = tuple(
    Setting(radar, mount, height_m, tilt_deg, far_m)
    for mount, height_m, tilt_deg, *far in (
        ("1.2 m", 1.2, 0.0, 3.0, 5.0),
        ("2.2 m, 23 degrees down", 2.2, 23.0, 2.7, 5.0),
        ("ceiling, 2.6 m, 60 degrees down", 2.6, 60.0, 2.0, 3.0),
    )
    for radar, far_m in zip((X2, X4M03), far, strict=True)
)


@dataclass(frozen=True, slots=True)
class Entry:
    """A row of the acceptance test: who comes, how often, and what is asked of the alarm."""

    name: str
    kind: Kind
    casts: tuple[tuple[Family, ...], ...]  # in turn; of a stay, what it does, one after another
    duration_s: float
    count: int  # passages of the whole test

    @property
    def label(self) -> str:
        """Who it is: 'human', 'pet', 'other' or 'empty'."""
        return self.casts[0][0].label if self.casts[0] else "empty"


def _pets(kind: str, styles: str, n: int = 1, **options: float) -> tuple[tuple[Family, ...], ...]:
    """Return casts of so many pets of a kind, one style after another."""
    return tuple(
        (replace(family(f"{kind} {style}"), options={"style": style, **options}),) * n
        for style in styles.split()
    )


def _entries() -> Iterator[Entry]:
    for s in SUITES:
        if s.name.startswith("walk test"):
            casts = (s.families(np.random.default_rng()),)
            yield Entry(s.name, "walk test", casts, s.duration_s, _N_ENTRIES)
    crossing = {"cat crosses": _pets("cat", "walk trot")}
    for kg in (5, 20, 36):
        crossing[f"dog of {kg} kg crosses"] = _pets("dog", "walk trot", mass_kg=float(kg))
    crossing["two cats cross"] = _pets("cat", "walk trot", 2)
    for name, pets in crossing.items():
        yield Entry(f"{name} the floor", "pets cross", pets, _VISIT_S, _N_ENTRIES)
    staying = {
        "cat": _pets("cat", "walk groom sit lie roam lie"),
        "dog of 20 kg": _pets("dog", "walk lie sniff pant roam lie", mass_kg=20.0),
    }
    for name, pets in staying.items():
        yield Entry(f"{name} for 10 to 60 min", "pets stay", pets, 0.0, _N_STAYS)
    for f in families("other", "things"):
        yield Entry(f.name, "thing", ((f,),), _THING_S, _N_THINGS)
    yield Entry("empty room", "thing", ((),), _THING_S, _N_THINGS)


ENTRIES = tuple(_entries())
_RECORDED: tuple[tuple[str, Kind, str, bool], ...] = (
    ("recorded people who go", "walk test", "human", False),
    ("recorded people in one place", "walk test", "human", True),
    ("recorded animals that go", "pets cross", "pet", False),
    ("recorded animals in one place", "pets cross", "pet", True),
)


@cache
def recorded_entries(folder: str, known: frozenset[str] = frozenset()) -> tuple[Entry, ...]:
    """Return entries of a folder's people and animals, each individual as often as the next.

    Clips whose SHA-256 is `known` are left out. Raises SceneError where the folder has none, and
    UsageError where none is left.
    """
    rows = recorded_families(folder, known)
    made = []
    for name, kind, label, stays in _RECORDED:
        casts = tuple((f,) for f in rows if (f.label, f.stays) == (label, stays))
        duration_s = _WALK_S if kind == "walk test" else _VISIT_S
        made += [Entry(name, kind, casts, duration_s, _N_ENTRIES)] if casts else []
    if not made:
        raise UsageError(f"{folder}: the bundle has learned from every clip; none is left to ask")
    return tuple(made)


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptSpec:
    """An acceptance test: its passages, and who judges them; or ModelMismatch."""

    model: str  # name or path of the bundle; 'auto': what the daemon takes before each radar
    seed: int = SEED
    share: float = 1.0  # of every entry's passages, at least one each
    knows: Knows = "nothing"  # of the installation
    clips: str = ""  # a folder: who comes moves as its clips do

    def __post_init__(self) -> None:
        """Check that there is a radar for the bundle."""
        if not self.settings:
            msg = f"bundle '{self.model}' takes neither of the radars: it cannot be accepted"
            raise ModelMismatch(msg)

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Radars and mounts that the bundle can judge."""
        if self.model == AUTO_MODEL:
            return SETTINGS
        bundle = load_bundle(self.model)
        return tuple(s for s in SETTINGS if bundle.takes(s.radar.axis(), s.radar.frame_rate_hz))

    @property
    def files(self) -> dict[str, str]:
        """Who judges: the bundles, with what each one's decisions follow from as a hash."""
        names = sorted({model_for(self.model, s.radar.stream()) for s in self.settings})
        return {name: load_bundle(name).judges_as for name in names}

    @property
    def version(self) -> str:
        """The test's version; with another seed than its own it is another test."""
        version = _RECORDED_VERSION if self.clips else VERSION
        return version if self.seed == SEED else f"{version}, seed {self.seed}"

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Who comes; or UsageError, if the bundles have learned from every clip."""
        return recorded_entries(self.clips, self._known) if self.clips else ENTRIES

    @property
    def new_clips(self) -> list[dict[str, str]]:
        """What is on the cards of clips from which no bundle here has learned."""
        return cards_of(read_library(Path(self.clips), self._known)) if self.clips else []

    @property
    def _known(self) -> frozenset[str]:
        return _learned_from(tuple(self.files))

    @property
    def n_passages(self) -> int:
        """Number of passages of all entries together."""
        return sum(map(self._count, self.entries))

    def _count(self, entry: Entry) -> int:
        return max(1, round(entry.count * self.share))

    def entry(self, number: int) -> tuple[int, int]:
        """Return which entry passage `number` is of, and which of its passages."""
        for index, entry in enumerate(self.entries):
            count = self._count(entry)
            if number < count:
                return index, number
            number -= count
        raise IndexError(number)

    def __call__(self, number: int) -> Mapping[str, NDArray[Any]]:
        """Return the columns of passage `number`, see `passage_columns`."""
        index, k = self.entry(number)
        entry, settings = self.entries[index], self.settings
        setting = settings[k % len(settings)]
        # Of the entry's own number, so that a share of the test is a part of it.
        rng = np.random.default_rng([self.seed, index, k])
        site = site_of(rng, setting)
        body_model = BodyModel.draw(rng, MOTIONS, tuple(SKINS), 1.0)
        told = np.random.default_rng([self.seed, index, k, _TOLD])
        config = installed(Config(), site, self.knows, told)
        pipeline, axis = self.pipeline(setting.radar, config), setting.radar.axis()
        cast = entry.casts[k // len(settings) % len(entry.casts)]
        duration_s, facts = entry.duration_s, {}
        if entry.kind in {"walk test", "pets cross"}:
            how: dict[str, Any] = {"lead_s": _LEAD_S, "is_plain": True, "body_model": body_model}
            played = play(rng, site, cast, duration_s=duration_s, **how)
            rows: Iterable[NDArray[Any]] = played.frames
            facts = in_view(played)
        else:
            duration_s = duration_s or float(rng.uniform(*_STAY_S))
            steps = _steps(rng, entry, site, body_model, duration_s)
            rows = Player(rng, site, steps).rows(round(duration_s * setting.radar.frame_rate_hz))
        return from_decisions(
            [pipeline.decide(each) for each in dwells(pipeline, rows, axis)],
            family=entry.name,
            label=entry.label,
            split=setting.name,
            suite=entry.name,
            build=str(k),
            duration_s=duration_s,
            **facts,
        )

    def pipeline(self, radar: Radar, config: Config) -> Pipeline:
        """Return what makes windows of a radar's frames, and decides on each."""
        return pipeline_for(self.model, radar.stream(), config)


@cache
def _learned_from(models: tuple[str, ...]) -> frozenset[str]:
    """Return the SHA-256 of every clip that bundles have learned from."""
    sidecars = (json.loads(sidecar_path(model).read_bytes()) for model in models)
    clips = (clip for each in sidecars for clip in each["training"].get("clips", {}).values())
    return frozenset(clip["sha256"] for clip in clips)


def accept(spec: AcceptSpec, folder: Path, crew: Crew, **about: str) -> PassageTable:
    """Play a test's passages, or what is missing of them in a folder, and return them judged.

    `about` is told of the folder's passages instead of what `spec` says of itself.
    """
    whole = {
        "kind": "acceptance",
        **asdict(spec),
        "version": spec.version,
        "clips": spec.new_clips,
        "files": list(spec.files.values()),
        "gate": GATE.model_dump(),
        **about,
    }
    make_shards(folder, whole, spec.n_passages, spec, crew, per_shard=_PER_SHARD)
    return PassageTable.load(folder)


def site_of(rng: np.random.Generator, setting: Setting) -> Site:
    """Return a drawn room with a radar as the setting has it."""
    radar = setting.radar
    antenna = Antenna(
        height_m=setting.height_m,
        tilt_deg=setting.tilt_deg,
        azimuth_width_deg=_BEAM_DEG,
        elevation_width_deg=_BEAM_DEG,
    )
    return replace(
        draw_site(rng, radar),
        antenna=antenna,
        level_db=float(rng.uniform(-_LEVEL_DB, _LEVEL_DB)),
        depth_m=setting.far_m - radar.near_m,
    )


def _steps(
    rng: np.random.Generator, entry: Entry, site: Site, body_model: BodyModel, duration_s: float
) -> tuple[SceneStep, ...]:
    """Return what moves in a long presence: a thing all the time, or a pet that does many."""
    is_thing, steps = len(entry.casts) == 1, []
    for cast in entry.casts:
        lead_s, options = ((-1.0, -1.0), {}) if is_thing else ((0.2, 2.5), body_model.options)
        bodies = tuple(actor(rng, site, f, lead_s, options, is_plain=True) for f in cast)
        # A crossing lasts seconds, what is done in a place lasts minutes.
        piece_s = duration_s / 10 if cast and cast[0].stays else _VISIT_S
        piece_s = duration_s if is_thing else piece_s
        steps.append(SceneStep(bodies, piece_s, piece_s))
    return tuple(steps)
