"""Windows: the maps of every decided dwell of random passages, with what is true of them.

Maps go into shards as bytes (0 to 255 for 0 to 1), which is a tenth of a decibel, far under
the noise of any of them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.judge.features import MAP_FEATURES, FeatureSettings, FeatureStream
from radard.judge.installation import echo_at_1m_db
from radard.stream.ring import Dwell, DwellShape
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins import SKINS
from x2train.sets.families import FAMILIES, LABELS, Use, draw_cast, draw_goer
from x2train.sets.passages import BodyModel, Passage, level_db_of, play
from x2train.sets.sites import RadarKind, RoomKind, clear_site, draw_close, draw_radar, draw_site

HOP_S = 1.0
GATE = GateSettings()  # the gate of sets and evaluations: the daemon's default, recorded with them
_VISIBLE_DB = 3.0  # over the noise
_MIN_SHARE = 0.12  # of a dwell, a quarter of a second
_LAW = 0x1A35  # marks the generator of motion and skin
_A_RADAR, _RADAR = 16, 0x5ADA  # passages that share one; marks its generator
_CLOSE_SHARE = 0.05  # of passages in usual rooms
_FAMILY = {f.name: k for k, f in enumerate(FAMILIES)}


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowSpec:
    """What windows are drawn from."""

    seed: int = 0  # passage k draws from ``[seed, k]``
    # families, or the body of a plug-in
    use: Use | str = "all"
    rooms: RoomKind = "usual"
    radar: RadarKind = "any"  # see `draw_radar`
    settings: FeatureSettings
    is_plain: bool = False  # without domain randomization
    longest_s: float = 6.0  # bodies are there for 2 s to so long
    motions: tuple[str, ...] = ("gait",)  # of `MOTIONS`, drawn evenly
    skins: tuple[str, ...] = ("surface",)  # of `SKINS`, likewise
    physical_share: float = 0.0  # of passages with cross sections that follow from sizes
    plain_share: float = 0.0  # of passages without domain randomization
    clear_share: float = 0.0  # of passages of one body that goes, in a room without multipath
    slow_share: float = 0.0  # of passages whose recorded bodies move slower than they did

    def __call__(self, number: int) -> Mapping[str, NDArray[Any]] | None:
        """Return the windows of passage `number`; None if it has none."""
        rng = np.random.default_rng([self.seed, number])
        label = LABELS[(0, 1, 0, 1, 2)[number % 5]]
        if self.use in {"staying", "held out", "thesis"}:
            label = LABELS[number % 2]
        elif self.use == "things":
            label = "other"
        cast = draw_cast(rng, label, self.use)
        # Passages beside each other share a radar: designing its maps takes as long as both.
        radar_rng = np.random.default_rng([self.seed, number // _A_RADAR, _RADAR])
        radar = draw_radar(radar_rng, self.radar)
        is_close = self.rooms == "usual" and rng.random() < _CLOSE_SHARE
        site = draw_close(rng, radar) if is_close else draw_site(rng, radar, self.rooms)
        duration_s = 2.6 + float(rng.uniform(2.0, self.longest_s))
        # A generator of its own: other laws leave the site and the course as they are.
        law_rng = np.random.default_rng([self.seed, number, _LAW])
        is_plain = self.is_plain or bool(law_rng.random() < self.plain_share)
        body_model = BodyModel.draw(law_rng, self.motions, self.skins, self.physical_share)
        if law_rng.random() < self.clear_share:
            cast, site = (draw_goer(law_rng, label, self.use),), clear_site(law_rng, site)
        if self.slow_share:
            body_model = replace(body_model, is_slow=law_rng.random() < self.slow_share)
        passage = play(
            rng, site, cast, duration_s=duration_s, is_plain=is_plain, body_model=body_model
        )
        return windows_of(passage, self.settings, number)


def windows_of(
    passage: Passage, settings: FeatureSettings, number: int
) -> Mapping[str, NDArray[Any]] | None:
    """Return the maps and the truth of a passage's open dwells; None if there are none."""
    radar = passage.site.radar
    axis, rate_hz = radar.axis(), radar.frame_rate_hz
    settings = settings.at(rate_hz)
    shape = settings.dwell_shape(HOP_S, rate_hz)
    remover, gate = ClutterRemover(), Gate(GATE, HOP_S)
    stream = FeatureStream(settings, MAP_FEATURES)
    rows: list[dict[str, Any]] = []
    n = shape.n_slow
    valid = np.ones(n, bool)
    for end in dwell_ends(shape, len(passage.frames)):
        frames = passage.frames[end - n : end]
        dwell = Dwell(frames, valid, axis, rate_hz, end / rate_hz, end_frame=end)
        moving = remover.remove(dwell)
        if not moving.is_whole:
            continue
        reading = gate.read(moving)
        if not reading.is_open:
            continue
        truth = _window_truth(passage, slice(end - n, end))
        if truth is None:
            continue
        maps = stream.extract(moving)
        echo_db = echo_at_1m_db(gate.power, gate.noise, axis.range_m)
        rows.append(
            truth
            | {name: np.rint(maps[name] * 255).astype(np.uint8) for name in MAP_FEATURES}
            | {
                "passage": number,
                "t_s": end / rate_hz,
                "power_db": reading.power_db,
                "excess_db": reading.power_db - reading.noise_floor_db,
                "range_m": reading.range_m,
                "frame_rate_hz": rate_hz,
                "echo_db": np.nan if echo_db is None else echo_db,
                "level_db": level_db_of(passage.site),
                "height_m": passage.site.antenna.height_m,
                "tilt_deg": passage.site.antenna.tilt_deg,
                "motion": MOTIONS.index(passage.body_model.motion),
                "skin": tuple(SKINS).index(passage.body_model.skin),
                "is_physical": passage.body_model.is_physical,
                "is_plain": passage.is_plain,
            }
        )
    if not rows:
        return None
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def dwell_ends(shape: DwellShape, n_frames: int) -> Iterator[int]:
    """Yield where the dwells of a stream end, as `FrameRing` cuts them."""
    hop = 0
    while (end := shape.n_slow + round(hop * shape.hop_s * shape.frame_rate_hz)) <= n_frames:
        yield end
        hop += 1


def _window_truth(passage: Passage, window: slice) -> dict[str, Any] | None:
    truth = passage.truth
    snr_db = truth.snr_db[window]
    visible = snr_db > _VISIBLE_DB
    share = visible.mean(axis=0)
    seen = [k for k in range(len(passage.cast)) if share[k] >= _MIN_SHARE]
    if not seen:
        return None
    k = min(seen, key=lambda i: (LABELS.index(passage.cast[i].label), i))
    rows = visible[:, k]
    speed = truth.speed_mps[window][rows, k]
    radial = truth.velocity_mps[window][rows, k]
    return {
        "label": LABELS.index(passage.cast[k].label),
        "family": _FAMILY.get(passage.cast[k].name, -1),
        "individual": passage.cast[k].individual,
        "company": _FAMILY[passage.cast[1 - k].name] if len(passage.cast) == 2 else -1,
        "share": float(share[k]),
        "snr_db": float(snr_db[rows, k].mean()),
        "true_range_m": float(truth.range_m[window][rows, k].mean()),
        "speed_mps": float(speed.mean()),
        "aspect": float(np.mean(np.abs(radial) / np.maximum(speed, 0.05))),
    }
