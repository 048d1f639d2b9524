"""What the modules' profiles report: status, lists and maps, one frozen class each.

Fields stand in wire order; arrays have shape (n,) and are float32 unless said otherwise.
Which bytes they become is `x2radar.wire.layouts`' business.
"""

from dataclasses import dataclass

from x2radar.wire.messages import ByteArray, FloatArray, Message, Opaque


@dataclass(frozen=True, slots=True)
class RespirationStatus(Message):
    """Status of the respiration and sleep profiles, 20 times a second.

    `state` is one of `wire_ids.RespirationState`; `state_data` are breaths per minute while
    breathing and percent while initialising.
    """

    counter: int
    state: int
    state_data: int
    distance_m: float
    movement_mm: float
    signal_quality: int


class RespirationStatusExt(Opaque):
    """Extended status of the respiration profile; its fields are unknown."""


@dataclass(frozen=True, slots=True)
class SleepStatus(Message):
    """Status of the sleep profile, once a second; movement in percent."""

    counter: int
    state: int
    respirations_per_min: float
    distance_m: float
    signal_quality: int
    movement_slow: float
    movement_fast: float


@dataclass(frozen=True, slots=True)
class PresenceStatus(Message):
    """Status of the presence profile (X2M300), presence 0 or 1; it carries no counter."""

    presence: int
    distance_m: float
    detection_value: float
    signal_quality: int


class PresenceStatusShort(PresenceStatus):
    """The same as the 2015 document prints it, with presence as one byte (not seen)."""


@dataclass(frozen=True, slots=True)
class PresenceSingle(Message):
    """Status of X4M300's presence profile (`wire_ids.PresenceState`).

    `direction` is 0 for still, 1 for towards the radar, 2 for away from it.
    """

    counter: int
    state: int
    distance_m: float
    direction: int
    signal_quality: int


@dataclass(frozen=True, slots=True, eq=False)
class PresenceMovingList(Message):
    """X4M300: movement per interval, and detections with RCS (cm^2) and velocity (m/s)."""

    counter: int
    state: int
    movement_slow: FloatArray
    movement_fast: FloatArray
    distance_m: FloatArray
    rcs_cm2: FloatArray
    velocity_mps: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RespirationMovingList(Message):
    """X4M200: slow and fast movement per interval."""

    counter: int
    movement_slow: FloatArray
    movement_fast: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RespirationDetectionList(Message):
    """X4M200: detections with RCS (cm^2) and velocity (m/s)."""

    counter: int
    distance_m: FloatArray
    rcs_cm2: FloatArray
    velocity_mps: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class NormalisedMovementList(Message):
    """Movement per range bin on its own range axis."""

    counter: int
    start_m: float
    bin_length_m: float
    movement_slow: FloatArray
    movement_fast: FloatArray


@dataclass(frozen=True, slots=True)
class VitalSigns(Message):
    """Respiration and heart rate with confidences, and movement."""

    counter: int
    state: int
    respirations_per_min: float
    respiration_distance_m: float
    respiration_confidence: float
    heart_beats_per_min: float
    heart_distance_m: float
    heart_confidence: float
    movement_slow: float
    movement_fast: float
    movement_start_m: float
    movement_end_m: float


@dataclass(frozen=True, slots=True)
class SleepStage(Message):
    """Stage of sleep; the numbers' meaning is unknown."""

    counter: int
    stage: int


@dataclass(frozen=True, slots=True, eq=False)
class DopplerRow(Message):
    """One range's power over Doppler frequency, linear."""

    counter: int
    matrix_counter: int
    range_index: int
    n_range_bins: int
    instance: int
    frame_rate_hz: float
    decimated_rate_hz: float
    doppler_start_hz: float
    doppler_step_hz: float
    range_m: float
    power: FloatArray


class PulseDoppler(DopplerRow):
    """One range's Doppler spectrum."""


class NoiseMap(DopplerRow):
    """One range's row of the noise map."""


@dataclass(frozen=True, slots=True, eq=False)
class DopplerRowBytes(Message):
    """One range's power over Doppler frequency, uint8: 10^((start + byte step) / 10)."""

    counter: int
    matrix_counter: int
    range_index: int
    n_range_bins: int
    instance: int
    byte_start_db: float
    byte_step_db: float
    frame_rate_hz: float
    decimated_rate_hz: float
    doppler_start_hz: float
    doppler_step_hz: float
    range_m: float
    power: ByteArray


class PulseDopplerBytes(DopplerRowBytes):
    """One range's Doppler spectrum in bytes."""


class NoiseMapBytes(DopplerRowBytes):
    """One range's row of the noise map in bytes."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterFile(Message):
    """A parameter file: name and content, uint8."""

    name: ByteArray
    content: ByteArray


class DecimStatus(Opaque):
    """Status of the decimating profile; its fields are unknown."""


@dataclass(frozen=True, slots=True)
class AppData(Message):
    """A profile's message that no other class describes."""

    message_id: int
    payload: bytes
