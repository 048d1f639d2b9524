"""The eight data sets and what the thesis reached on them (tables 4.2, 4.6, 4.7)."""

from dataclasses import dataclass
from typing import Literal

_Animal = Literal["dog", "cat", "pet"]
RATES_HZ = (60, 200)  # the thesis'


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """One of the thesis' data sets: vector, animal and frame rate."""

    vector: int  # 1, or 2 for the range profile in front of type 1
    # class 1; people are class 2. 'pet', dogs and cats in turn, is not the thesis'
    animal: _Animal
    frame_rate_hz: int  # 60 or 200 in the thesis; any in this recipe

    @property
    def bodies(self) -> tuple[str, ...]:
        """What class 1 is drawn from."""
        return ("dog", "cat") if self.animal == "pet" else (self.animal,)

    @property
    def name(self) -> str:
        """Name of the set as the thesis writes it, such as T1D60."""
        return f"T{self.vector}{self.animal[0].upper()}{self.frame_rate_hz}"


CELLS: tuple[Cell, ...] = tuple(
    Cell(vector, animal, rate)
    for animal in ("dog", "cat")
    for vector in (1, 2)
    for rate in RATES_HZ
)
"""In the thesis' order."""

PRINTED: dict[tuple[str, str], tuple[float, float]] = {
    ("T1D60", "relu"): (61.4, 0.369),
    ("T1D200", "relu"): (77.8, 0.471),
    ("T2D60", "relu"): (83.6, 0.204),
    ("T2D200", "relu"): (84.0, 0.449),
    ("T1C60", "relu"): (75.4, 0.328),
    ("T1C200", "relu"): (84.4, 0.218),
    ("T2C60", "relu"): (80.0, 0.232),
    ("T2C200", "relu"): (88.8, 0.368),
    ("T1D60", "sigmoid"): (57.8, 0.690),
    ("T1D200", "sigmoid"): (72.4, 1.019),
    ("T2D60", "sigmoid"): (80.4, 0.778),
    ("T2D200", "sigmoid"): (85.6, 0.962),
    ("T1C60", "sigmoid"): (73.2, 0.460),
    ("T1C200", "sigmoid"): (82.8, 0.636),
    ("T2C60", "sigmoid"): (77.4, 0.730),
    ("T2C200", "sigmoid"): (86.8, 0.753),
}
"""Total accuracy in per cent on 500 elements, and cross-entropy: best of ten trainings."""
