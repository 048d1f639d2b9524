"""Folders of the daemon: state that must outlive it, and the status of this moment.

systemd names both folders (StateDirectory=, RuntimeDirectory=); run by hand, they are the
user's own, and the former holds only what the last command was (armed or not). Clips, large and
private, are made only where a folder was named.
"""

import os
from collections.abc import Mapping
from pathlib import Path

from radard.config.config import Config
from radard.config.folders import (
    made_up_folder,
    named_state_folder,
    own_folder,
    state_folder,
    temporary_folder,
)
from radard.config.saved import Kind, saved_path

SYSTEM_RUNTIME_DIR = Path("/run/radard")
"""RuntimeDirectory= of the unit in deploy/systemd."""


def state_dir(config: Config, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of what is kept over a restart."""
    return state_folder(config.service.state_dir, environ)


def saved_file(config: Config, kind: Kind, environ: Mapping[str, str] = os.environ) -> Path:
    """Return where the dashboard keeps the sensor's 'zones' or 'settings'."""
    sensor = config.sensor
    return saved_path(config.service.state_dir, environ, sensor.name, sensor.port, kind)


def calibration_file(config: Config, environ: Mapping[str, str] = os.environ) -> Path:
    """Return where the calibration of the sensor's room is kept."""
    return state_dir(config, environ) / f"{config.sensor.name}.calibration.json"


def kept_calibration(config: Config) -> Path:
    """Return where a running sensor keeps the calibration that it makes."""
    if config.gate.calibration not in {"auto", "none"}:
        return Path(config.gate.calibration)
    if config.sensor.kind != "sim":
        return calibration_file(config)
    folder = made_up_folder(named=config.service.state_dir, environ=os.environ)
    return folder / f"{config.sensor.name}.sim.calibration.json"


def clip_dir(config: Config, environ: Mapping[str, str] = os.environ) -> Path | None:
    """Return the folder of a sensor's clips; None when there shall be none."""
    if not config.clips.enabled:
        return None
    named = named_state_dir(config, environ)
    folder = config.clips.dir or (named / "clips" if named is not None else None)
    if folder is not None and config.is_one_of_several:
        return folder / config.sensor.name
    return folder


def log_path(config: Config, environ: Mapping[str, str] = os.environ) -> Path | None:
    """Return the file of the event log; None with replays, or a sensor simulated by hand.

    What such a run leaves undelivered must not be taken for the real sensor's.
    """
    kinds = {each.sensor.kind for each in config.each()}
    if kinds == {"replay"}:
        return None
    by_hand = kinds & {"sim", "replay"}
    folder = named_state_dir(config, environ) if by_hand else state_dir(config, environ)
    return folder / "log.db" if folder is not None else None


def status_dirs(config: Config, environ: Mapping[str, str] = os.environ) -> tuple[Path, ...]:
    """Return where a status file may lie, as seen by another user than the daemon's."""
    own = runtime_dir(config, environ)
    is_named = config.service.runtime_dir is not None or "RUNTIME_DIRECTORY" in environ
    return (own,) if is_named else (SYSTEM_RUNTIME_DIR, own)


def runtime_dir(config: Config, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the status file.

    The one in /tmp that stands in for systemd's or the session's is used only if nobody else
    could have made it or may write there; else it is below the state directory.
    """
    if config.service.runtime_dir is not None:
        return config.service.runtime_dir
    if given := environ.get("RUNTIME_DIRECTORY"):
        return Path(given.partition(":")[0])
    if given := environ.get("XDG_RUNTIME_DIR"):
        return Path(given) / "radard"
    return temporary_folder() or state_folder(config.service.state_dir, environ) / "run"


def demo_state(config: Config, environ: Mapping[str, str] = os.environ) -> Config:
    """Return the configuration, with a folder for state where only simulations are on a page.

    So a demo has clips to replay and to label. The folder ends with the process, unless one was
    named: what was tried on a demo's page must change no later run.
    """
    is_sim = {each.sensor.kind for each in config.each()} == {"sim"}
    has_page = any(output.startswith("http:") for output in config.output)
    if not (is_sim and has_page) or named_state_dir(config, environ) is not None:
        return config
    service = config.service.model_copy(update={"state_dir": own_folder()})
    return config.model_copy(update={"service": service})


def named_state_dir(config: Config, environ: Mapping[str, str] = os.environ) -> Path | None:
    """Return the folder that configuration or systemd names for state, if any."""
    return named_state_folder(config.service.state_dir, environ)
