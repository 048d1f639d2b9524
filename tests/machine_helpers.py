"""State machines of tests: a thousand steps each, or as many as RADARD_STEPS says."""

import os

from hypothesis import HealthCheck, settings

STEPS = int(os.environ.get("RADARD_STEPS", "1000"))


def machine_settings(per_example: int = 50) -> settings:
    """Settings of a machine that goes so many steps in all, `per_example` from each start."""
    steps = {"max_examples": max(1, STEPS // per_example), "stateful_step_count": per_example}
    return settings(**steps, deadline=None, suppress_health_check=list(HealthCheck))
