"""deploy/: every file parses, and names only what there is."""

import json
import re
import tomllib
from fnmatch import fnmatchcase
from itertools import combinations
from pathlib import Path

import pytest
import yaml

from radard.config.sink_table import MqttSection, WebSection
from radard.outputs.mqtt.homeassistant import entities
from radard.web import metrics
from x2radar.device.discovery import USB_IDS

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
LABELS = {
    *("instance", "job", "state", "kind", "phase", "gate", "label", "reason", "sink", "le"),
    *("version", "model", "sensor"),
}
FUNCTIONS = {
    *("rate", "increase", "changes", "time", "sum", "max", "by", "histogram_quantile"),
    *("ignoring", "group_left"),
}


def unit():
    """Sections of the unit: key to its values, in order."""
    sections = {}
    for raw in (DEPLOY / "systemd/radard.service").read_text().splitlines():
        line = raw.strip()
        if not line or line.startswith("#"):
            continue
        if head := re.fullmatch(r"\[(\w+)\]", line):
            here = sections.setdefault(head[1], {})
            continue
        key, equals, value = line.partition("=")
        assert equals
        assert re.fullmatch(r"[A-Z]\w+", key)
        here.setdefault(key, []).append(value)
    return sections


def test_unit_notifies_and_is_watched():
    service = unit()["Service"]
    assert service["Type"] == ["notify"]
    assert float(service["WatchdogSec"][0]) == 10
    assert service["User"] == ["radard"]
    assert service["SupplementaryGroups"] == ["dialout"]
    assert service["StateDirectory"] == service["RuntimeDirectory"] == ["radard"]
    # What does not get right by itself, and nothing else.
    assert service["RestartPreventExitStatus"] == ["2 4 78"]
    # The daemon's own five seconds, and one to spare.
    assert float(service["TimeoutStopSec"][0]) == 6
    assert unit()["Install"]["WantedBy"] == ["multi-user.target"]
    assert service["MemoryMax"] == ["1G"]
    # What ends for good is told, by a unit that there is.
    (told,) = unit()["Unit"]["OnFailure"]
    assert (DEPLOY / "systemd" / told.replace("%n", "")).is_file()


def test_every_udev_line_is_a_rule():
    match = r'(?:ACTION|SUBSYSTEM|ATTRS\{\w+\}|ENV\{\w+\})(?:==|!=)"[^"]+"'
    act = r'(?:GOTO|GROUP|MODE|LABEL|ENV\{\w+\})="[^"]+"|(?:SYMLINK|TAG)\+="[^"]+"'
    text = (DEPLOY / "udev/60-x2radar.rules").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    for line in lines:
        parts = re.split(r", (?=[A-Z])", line)
        assert all(re.fullmatch(f"{match}|{act}", part) for part in parts), line
    ignored = [line for line in lines if 'ENV{ID_MM_DEVICE_IGNORE}="1"' in line]
    assert len(ignored) == 1
    assert 'SYMLINK+="x2radar"' in ignored[0]
    targets = set(re.findall(r'GOTO="(\w+)"', text))
    assert targets == set(re.findall(r'LABEL="(\w+)"', text))


def test_udev_ids_are_those_of_the_driver():
    text = (DEPLOY / "udev/60-x2radar.rules").read_text()
    ids = re.findall(r'idVendor\}=="(\w+)", ATTRS\{idProduct\}=="(\w+)"', text)
    assert {(int(v, 16), int(p, 16)) for v, p in ids} == set(USB_IDS)
    # No id is only a radar's: the maker's name in the device's texts, or a serial number.
    for line in text.splitlines():
        if "idVendor" in line and "ATTRS{serial}" in line:
            assert line.startswith("#")
        elif "idVendor" in line:
            assert re.search(r'ATTRS\{(manufacturer|product)\}=="[^"]+"', line)


@pytest.mark.parametrize(
    ("manufacturer", "product", "is_radar"),
    [
        ("Novelda AS", "XeThru X4M200", True),
        ("ATMEL", "AT91USBSerial", False),
        ("Arduino LLC", "Arduino Due Prog. Port", False),
        ("Atmel", "X4M03", True),
        ("XeThru", "Virtual COM Port", True),
    ],
)
def test_a_board_that_only_shares_the_id_is_no_radar(manufacturer, product, is_radar):
    text = (DEPLOY / "udev/60-x2radar.rules").read_text()
    named = {"manufacturer": manufacturer, "product": product}
    wanted = re.findall(
        r'^ATTRS\{idVendor\}.*ATTRS\{(manufacturer|product)\}=="([^"]+)"', text, re.MULTILINE
    )
    assert len(wanted) == 4
    found = [fnmatchcase(named[key], p) for key, patterns in wanted for p in patterns.split("|")]
    assert any(found) == is_radar


def instructions():
    text = (DEPLOY / "container/Containerfile").read_text()
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    whole = "\n".join(lines).replace("\\\n", " ")
    return [tuple(line.split(None, 1)) for line in whole.splitlines() if line.strip()]


def test_container_is_healthy_by_the_health_command_and_no_root():
    steps = instructions()
    known = {
        *(
            "ARG",
            "FROM",
            "WORKDIR",
            "COPY",
            "RUN",
            "ENV",
            "USER",
            "VOLUME",
            "EXPOSE",
            "STOPSIGNAL",
        ),
        *("HEALTHCHECK", "ENTRYPOINT", "CMD"),
    }
    assert {name for name, _ in steps} <= known
    last = dict(steps)
    health = last["HEALTHCHECK"]
    assert json.loads(health[health.index("CMD") + 3 :]) == ["radard", "health"]
    assert last["USER"] == "radard"
    assert json.loads(last["ENTRYPOINT"]) == ["radard"]
    assert json.loads(last["CMD"]) == ["--port", "sim:demo"]


def test_container_is_made_of_one_image_that_can_be_pinned_and_of_files_with_hashes():
    steps = instructions()
    assert steps[0] == ("ARG", "BASE=docker.io/library/python:3.12-slim")
    assert [rest.split()[0] for name, rest in steps if name == "FROM"] == ["$BASE", "$BASE"]
    (build,) = (rest for name, rest in steps if name == "RUN" and "venv" in rest)
    assert "--require-hashes --requirement requirements.txt" in build
    # And nothing beside them.
    assert "--no-index --no-build-isolation '.[daemon]'" in build


def test_container_copies_what_the_package_needs():
    copied = set()
    for name, rest in instructions():
        if name == "COPY" and not rest.startswith("--from"):
            copied.update(rest.split()[:-1])
    assert all((ROOT / each).exists() for each in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    folders = project["tool"]["setuptools"]["package-dir"].values()
    assert {folder.split("/")[0] for folder in folders} <= copied
    assert {project["project"]["readme"], *project["project"]["license-files"]} <= copied


def test_home_assistant_names_entities_that_discovery_makes():
    text = (DEPLOY / "homeassistant/radard.yaml").read_text()
    package = yaml.safe_load(text)
    made = {
        f"{entity.platform}.radar_{entity.config['name'].lower().replace(' ', '_')}"
        for entity in entities(MqttSection(), takes_commands=True)
    } | {f"button.radar_{name}" for name in ("arm", "disarm", "ack")}
    named = set(re.findall(r"\b(?:binary_sensor|sensor|button)\.\w+", text)) - {"button.press"}
    assert named <= made
    for automation in package["automation"]:
        assert {"id", "alias", "triggers", "actions"} <= set(automation)
    ids = [automation["id"] for automation in package["automation"]]
    assert len(set(ids)) == len(ids)


def check_expression(text):
    """Every metric, label and function of an expression is one that there is."""
    assert text.count("(") == text.count(")")
    assert text.count("{") == text.count("}")
    for inside in re.findall(r"\{([^}]*)\}", text):
        assert set(re.findall(r"(\w+)\s*(?:=~|!=|=)", inside)) <= LABELS
    bare = re.sub(r"\{[^}]*\}|\[[^\]]*\]|\"[^\"]*\"", "", text)
    words = set(re.findall(r"[A-Za-z_]\w*", bare)) - LABELS - FUNCTIONS - {"up", "e"}
    for word in words:
        assert metrics._family(word) in metrics.HELP, f"{word} in {text}"


def test_prometheus_scrapes_and_its_rules_know_their_metrics():
    scrape = yaml.safe_load((DEPLOY / "prometheus/prometheus.yml").read_text())
    (job,) = scrape["scrape_configs"]
    text = (DEPLOY / "prometheus/prometheus.yml").read_text()
    assert all(key in WebSection.model_fields for key in re.findall(r"`web\.(\w+)`", text))
    assert job["static_configs"] == [{"targets": ["127.0.0.1:8434"]}]
    (file,) = scrape["rule_files"]
    (group,) = yaml.safe_load((DEPLOY / "prometheus" / file).read_text())["groups"]
    names = [rule["alert"] for rule in group["rules"]]
    assert len(set(names)) == len(names)
    for rule in group["rules"]:
        check_expression(rule["expr"])
        assert rule["labels"]["severity"] in {"warning", "critical"}
        assert re.fullmatch(r"\d+[smh]", rule.get("for", "1s"))
        used = set(re.findall(r"\$labels\.(\w+)", rule["annotations"]["summary"]))
        assert used <= {"instance", "sink"}


def board():
    return json.loads((DEPLOY / "grafana/radard.json").read_text())


def test_dashboard_shows_metrics_that_there_are():
    expressions = [t["expr"] for panel in board()["panels"] for t in panel["targets"]]
    assert len(expressions) > 10
    for text in expressions:
        check_expression(text.replace("$__rate_interval", "1m"))
    variables = {each["name"] for each in board()["templating"]["list"]}
    used = set(re.findall(r"\$\{?([a-z]\w*)", json.dumps(board())))
    assert used <= variables


def test_panels_do_not_overlap():
    panels = board()["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    for a, b in combinations((panel["gridPos"] for panel in panels), 2):
        apart = (
            a["x"] + a["w"] <= b["x"]
            or b["x"] + b["w"] <= a["x"]
            or a["y"] + a["h"] <= b["y"]
            or b["y"] + b["h"] <= a["y"]
        )
        assert apart
    assert all(p["gridPos"]["x"] + p["gridPos"]["w"] <= 24 for p in panels)


@pytest.mark.parametrize("text", ["radard_nothing_total", 'rate(radard_up{colour="x"}[1m])'])
def test_the_check_itself_can_fail(text):
    with pytest.raises(AssertionError):
        check_expression(text)
