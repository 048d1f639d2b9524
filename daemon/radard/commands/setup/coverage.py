"""What a mount would see: the simulator's beam and link budget over height and range."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from radard.dsp.velocity import CPI_S
from x2radar.frame import SPEED_OF_LIGHT_MPS
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power

# Rows and columns of the table: from a pet's paws to a tall adult, over the X2's swath.
HEIGHTS_M = (0.1, 0.3, 0.5, 0.8, 1.2, 1.7)
DISTANCES_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
ANGLES_DEG = (0, 20, 40, 60, 80)


@dataclass(frozen=True, slots=True)
class CoverageOptions:
    """A mount, and what is to be seen from there."""

    height_m: float  # of the radar over the floor
    tilt_deg: float  # down from level
    width_deg: float  # of the beam, full at half power
    limit_db: float  # least that is seen
    rcs_m2: float  # cross section


def snr_db(mount: CoverageOptions, x_m: float, y_m: float, z_m: float) -> float | None:
    """Return the echo over noise at x_m right, y_m ahead, z_m up; None outside the swath."""
    axis = RadarSettings().axis
    budget, width_deg = LinkBudget(), mount.width_deg
    antenna = Antenna(
        height_m=mount.height_m,
        tilt_deg=mount.tilt_deg,
        azimuth_width_deg=width_deg,
        elevation_width_deg=width_deg,
    )
    towards_m = np.array([x_m, y_m, z_m]) - antenna.position_m
    range_m = float(np.linalg.norm(towards_m))
    if not axis.range_m[0] <= range_m <= axis.range_m[-1]:
        return None
    amplitude = budget.amplitude(np.array([range_m]), np.array([mount.rcs_m2 * SEED_GAIN]), axis)
    # The pattern counts once for the amplitude: out and back.
    amplitude *= antenna.gain(towards_m)
    noise = baseband_noise_power(axis, budget.noise_sigma)
    return float(10 * np.log10(amplitude[0] ** 2 / noise))


def coverage_table(mount: CoverageOptions) -> Iterator[str]:
    """Yield the lines for a mount: ahead by height and distance, then to the side."""
    axis = RadarSettings().axis
    down = f"tilted {mount.tilt_deg:g} degrees down, beam {mount.width_deg:g} degrees"
    yield f"radar {mount.height_m:g} m over the floor, {down};"
    yield f"dB over the noise of one frame, for {mount.rcs_m2:g} m2; below {mount.limit_db:g}: ."
    yield f"-: outside the swath, {axis.range_m[0]:.1f} to {axis.range_m[-1]:.1f} m from the radar"
    yield ""
    yield "straight ahead".ljust(16) + "".join(f"{y:6.1f} m" for y in DISTANCES_M)
    for z_m in reversed(HEIGHTS_M):
        cells = (_cell(mount, 0.0, y_m, z_m) for y_m in DISTANCES_M)
        yield f"{z_m:.1f} m high".ljust(16) + "".join(cells)
    yield ""
    yield f"{HEIGHTS_M[2]:g} m high, off to the side"
    for angle_deg in ANGLES_DEG:
        angle = np.deg2rad(angle_deg)
        right, ahead = float(np.sin(angle)), float(np.cos(angle))
        cells = (_cell(mount, d * right, d * ahead, HEIGHTS_M[2]) for d in DISTANCES_M)
        yield f"{angle_deg} degrees".ljust(16) + "".join(cells)
    yield ""
    slowest = SPEED_OF_LIGHT_MPS / axis.carrier_hz / 2 / CPI_S
    yield f"slower than {100 * slowest:.0f} cm/s towards or away from the radar counts as standing"


def _cell(mount: CoverageOptions, x_m: float, y_m: float, z_m: float) -> str:
    level_db = snr_db(mount, x_m, y_m, z_m)
    if level_db is None:
        return f"{'-':>8}"
    return f"{'.':>8}" if level_db < mount.limit_db else f"{level_db:8.0f}"
