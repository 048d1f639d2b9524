"""What a profile costs: CPU time, people missed, pets' alarms, as they were measured."""

from collections.abc import Iterator

from radard.config.config import Config
from radard.config.profiles import USUAL_HZ, Profile, Three, front
from radard.config.sections import DecisionSection
from radard.judge.bundle import Bundle
from radard.judge.model_choice import model_for
from x2radar.ports import parse_port


def in_use(config: Config) -> Profile | None:
    """Return the profile whose settings hold, with all else of a decision as usual; else None."""
    if config.alarm.sensitivity != "normal":
        return None
    port = config.sensor.port
    asked = parse_port(port).options.get("rate") if port else None
    for profile in front().profiles:
        settings = DecisionSection(hop_s=profile.hop_s, bodies=profile.bodies)
        is_same = config.decision == settings and model_for(profile.model) == model_for(
            config.model.name
        )
        if asked is None:
            is_timed = profile.rate_hz is None or config.model.profile == profile.name
        else:
            is_timed = float(asked) == (profile.rate_hz or USUAL_HZ)
        if is_same and is_timed:
            return profile
    return None


def profile_lines(config: Config, bundle: Bundle) -> Iterator[str]:
    """Yield what the profile in use costs."""
    profile = in_use(config)
    if profile is None:
        yield "no profile: what these settings cost was not measured together; see radard bench"
        return
    known = front().profiles
    yield (
        f"profile {profile.name}: CPU {_times(profile, known[-1])} with an open gate, "
        f"{100 * profile.cpu_closed:.0f} % in an empty room;"
    )
    yield f"  people missed {percent(profile.missed)},"
    yield f"  pets' visits with an alarm {percent(profile.pets)},"
    yield f"  alarm after {profile.half_s:.1f} s (half), {profile.slow_s:.1f} s (90 %)"
    yield f"  of {basis(profile.passages)}"
    if front().bundles.get(bundle.name, bundle.sha256) != bundle.sha256:
        yield f"  (measured with an earlier '{bundle.name}')"


def percent(three: Three) -> str:
    """Return a share and its interval."""
    value, low, high = (f"{100 * v:.2g}" for v in three)
    return f"{value} % ({low} to {high})"


def basis(n: int) -> str:
    """Return on what errors were measured."""
    return f"{n} simulated people and {n} visits of pets before an X2"


def _times(profile: Profile, dearest: Profile) -> str:
    if profile == dearest:
        return "as much as any profile takes"
    return f"{100 * profile.cpu_open:.0f} % of what '{dearest.name}' takes"
