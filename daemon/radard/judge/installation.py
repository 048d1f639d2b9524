"""What an installation knows besides the motion: frame rate, mount, and how strong the echo is.

A network may take it as one more input, in which everything may be missing. The strength is that
of the whole body, compared with an adult before the same radar (`mount.level_db`).
"""

import numpy as np
from numpy.typing import NDArray

INSTALLATION = "installation"
N_INSTALLATION = 7  # frame rate; whether height is known, and it; the same of tilt, strength
_RATE_HZ, _HEIGHT_M, _TILT_DEG, _STRENGTH_DB = 60.0, 1.5, 30.0, 10.0  # units of the input
_MAX = 4.0  # units that any of them counts at most
_STANDS_OUT = 10**0.5  # times its floor, a bin's power counts: as the gate has it
_HUMAN_DB, _PET_DB, _SIGMA_DB = 2.6, -3.4, 6.2
"""A visit's greatest strength: medians of 2,127 people and 2,034 pets who come in, linger and
leave before simulated radars, of generators and recorded, and half of the middle 68 %."""
_LEVEL_DB = 2.0  # sigma: what a walk test repeats to
_FOR_HUMAN, _FOR_PET = 0.5, 2.0  # at most so many nats: a person may be half hidden


def echo_at_1m_db(
    power: NDArray[np.float64], floor: NDArray[np.float64], range_m: NDArray[np.float64]
) -> float | None:
    """Return how strong what moves would be at 1 m, in dB over the noise; None if nothing moves.

    Of the bins' power without static clutter, the receiver's noise (`Gate.noise`) and their
    ranges. All that stand out are added, by the fourth power of the strongest one's range (the
    radar equation): by each one's own, echoes' tails would count too much.
    """
    over = np.where(power > _STANDS_OUT * floor, power - floor, 0.0)
    noise = float(np.median(floor)) if len(floor) else 0.0
    total = float(over.sum())
    if not (0.0 < total < np.inf and noise > 0.0):
        return None
    at_m = max(float(range_m[int(np.argmax(over))]), 0.1)
    return float(10 * np.log10(total / noise) + 40 * np.log10(at_m))


def installation(
    frame_rate_hz: float,
    height_m: float | None = None,
    tilt_deg: float | None = None,
    strength_db: float | None = None,
) -> NDArray[np.float32]:
    """Return the input, shape (`N_INSTALLATION`,), float32; zeros for what is not known.

    The radar hangs `height_m` over the floor, `tilt_deg` down from level; its echo is
    `strength_db` over an adult's.
    """
    values = [np.log2(frame_rate_hz / _RATE_HZ)]
    for value, unit, middle in (
        (height_m, _HEIGHT_M, _HEIGHT_M),
        (tilt_deg, _TILT_DEG, 0.0),
        (strength_db, _STRENGTH_DB, 0.0),
    ):
        values += [0.0, 0.0] if value is None else [1.0, (value - middle) / unit]
    return np.clip(values, -_MAX, _MAX).astype(np.float32)


def size_nats(strength_db: float) -> float:
    """Return what `strength_db` over an adult's says for a person, in nats of log odds."""
    per_db = (_HUMAN_DB - _PET_DB) / (_SIGMA_DB**2 + _LEVEL_DB**2)
    nats = per_db * (strength_db - (_HUMAN_DB + _PET_DB) / 2)
    return min(max(nats, -_FOR_PET), _FOR_HUMAN)
