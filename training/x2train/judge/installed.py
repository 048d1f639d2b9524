"""What an installation knows, as `mount` in the configuration says it to the daemon."""

from typing import Literal, get_args

import numpy as np

from radard.config.config import Config
from x2train.sets.known import ADULT_DB, LEVEL_ERROR_DB
from x2train.sets.passages import level_db_of
from x2train.sets.sites import Site

Knows = Literal["nothing", "mount", "mount and level"]
KNOWS: tuple[Knows, ...] = get_args(Knows)


def installed(config: Config, site: Site, knows: Knows, rng: np.random.Generator) -> Config:
    """Return a configuration that says so much of a site; the level is as `rng` errs."""
    if knows == "nothing":
        return config
    known = {"height_m": site.antenna.height_m, "tilt_deg": site.antenna.tilt_deg}
    if knows == "mount and level":
        error_db = LEVEL_ERROR_DB * rng.standard_normal()
        known["level_db"] = float(level_db_of(site) + ADULT_DB + error_db)
    return config.model_copy(update={"mount": config.mount.model_copy(update=known)})
