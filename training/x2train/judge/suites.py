"""Suites: what a bundle is judged on, case by case.

The walk test is modelled on EN 50131-2-3 for indoor detectors (across at 1.0 m/s, slow, fast,
close in, crawling, intermittent): the same movements before a simulated radar, no more.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from radard.errors import UsageError
from x2radar.sim.points import Label
from x2train.sets.families import FAMILIES, Family, draw_family, family
from x2train.sets.sites import P4XX, X2, Radar, RoomKind, Site, draw_close, draw_radar, draw_site


@dataclass(frozen=True, slots=True)
class Suite:
    """A suite of the evaluation: who comes, before which radar, in which rooms."""

    name: str  # for reports; 'walk test: ...' for those
    split: str  # what is new to the network in it
    share: float  # passages of it, of those that a run makes
    cast: tuple[Label | Family, ...] = ()  # a label draws one of training
    radar: Radar | None = X2  # None: drawn, as in training
    rooms: RoomKind = "usual"
    is_close: bool = False  # whether bodies are close to the radar, see `draw_close`
    duration_s: float = 14.0

    def families(self, rng: np.random.Generator) -> tuple[Family, ...]:
        """Return who moves in a passage."""
        return tuple(
            f if isinstance(f, Family) else draw_family(rng, f, "train") for f in self.cast
        )

    @property
    def is_of_pets(self) -> bool:
        """Whether pets alone move in it."""
        labels = {c.label if isinstance(c, Family) else c for c in self.cast}
        return labels == {"pet"}

    def drawn_site(self, rng: np.random.Generator) -> Site:
        """Return the site of a passage, with its radar."""
        radar = self.radar or draw_radar(rng)
        return draw_close(rng, radar) if self.is_close else draw_site(rng, radar, self.rooms)

    def before(self, radar: Radar) -> "Suite":
        """Return the same bodies before another radar."""
        if self.radar in {X2, _NEAR_X2}:
            return replace(self, radar=radar)
        name = self.name.partition(",")[0]
        return replace(self, name=name, split="train families", radar=radar)


_PET_S = 20.0  # a visit: a pet crosses and lingers
_GOLDEN = (5**0.5 - 1) / 2  # see `suite_of`
_WALK = family("human walk")
_NEAR_X2 = replace(X2, near_m=0.3, far_m=3.1)  # looks at who is close


def _walk(name: str, style: str = "walk", *, duration_s: float = 14.0, **options: object) -> Suite:
    name = f"walk test: {name}"
    body = replace(_WALK, name=name, options={"style": style, **options})
    return Suite(name, "train families", 2.0, (body,), duration_s=duration_s)


def _both(where: str, split: str, share: float, **more: Any) -> tuple[Suite, Suite]:
    """Return people and pets, each in a suite of its own, in the same circumstances."""
    return (
        Suite(f"people, {where}", split, share, ("human",), **more),
        Suite(f"pets, {where}", split, share, ("pet",), **more, duration_s=_PET_S),
    )


def _suites() -> Iterator[Suite]:
    known, held_out = "train families", "held out families"
    yield Suite("people", known, 12, ("human",))
    yield Suite("pets", known, 30, ("pet",), duration_s=_PET_S)
    yield Suite("two pets", known, 3, ("pet", "pet"), duration_s=_PET_S)
    yield from _both("unseen rooms", "unseen rooms", 6, rooms="unseen")
    yield from _both("other radars", "other radars", 4, radar=None)
    yield Suite("pets, P4xx", "other radars", 3, ("pet",), P4XX, duration_s=_PET_S)
    yield Suite("person with dog", held_out, 3, (_WALK, family("dog walk")))
    yield Suite("person behind a fan", known, 3, (_WALK, family("fan")))
    yield from _both("close up", known, 3, radar=_NEAR_X2, is_close=True)
    yield _walk("across at 1.0 m/s", course="cross", speed_mps=1.0)
    yield _walk("slow, 0.2 m/s", "stealth", speed_mps=0.2, duration_s=25.0)
    yield _walk("fast, 3 m/s", "run", speed_mps=3.0)
    yield _walk("close in", far_m=1.2, course="cross", speed_mps=0.7)
    yield _walk("crawling", "crawl", speed_mps=0.4, duration_s=20.0)
    yield _walk("intermittent", "stop_and_go", duration_s=20.0)
    for f in FAMILIES:
        if f.use == "held out":
            duration_s = 14.0 if f.label == "human" else _PET_S
            yield Suite(f.name, held_out, 3, (f,), duration_s=duration_s)
        if f.label == "other":
            yield Suite(f.name, known, 1, (f,), duration_s=30.0)
    yield Suite("empty room", known, 2, duration_s=60.0)


SUITES = tuple(_suites())


def suite_of(number: int, n_passages: int, only: Collection[str] = ()) -> Suite:
    """Return the suite of a passage, the same for every seed; `only` names some of them."""
    suites = named_suites(only)
    at = (number + 0.5) / n_passages
    if number >= n_passages:
        suites = [s for s in suites if s.is_of_pets]
        # The golden ratio's multiples spread evenly, however many are taken.
        at = (number - n_passages + 0.5) * _GOLDEN % 1
    edges = np.cumsum([s.share for s in suites])
    return suites[int(np.searchsorted(edges, at * edges[-1]))]


def n_more_pets(pet_hours: float, n_passages: int, only: Collection[str] = ()) -> int:
    """Return how many visits must follow for pets to last so many hours; or UsageError."""
    suites = [suite_of(k, n_passages, only) for k in range(n_passages)]
    missing_s = 3600 * pet_hours - sum(s.duration_s for s in suites if s.is_of_pets)
    if missing_s > 0 and not any(s.is_of_pets for s in named_suites(only)):
        raise UsageError("--pet-hours: none of the suites is of pets")
    return max(0, int(np.ceil(missing_s / _PET_S)))


def named_suites(only: Collection[str]) -> list[Suite]:
    """Return the suites of these names, all of none; UsageError if there is none of one."""
    unknown = [name for name in only if name not in {s.name for s in SUITES}]
    if unknown:
        raise UsageError(f"--only '{unknown[0]}': suites are {', '.join(s.name for s in SUITES)}")
    return [s for s in SUITES if not only or s.name in only]
