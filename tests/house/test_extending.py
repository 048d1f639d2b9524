"""Plug-ins: each example of docs/research/extending.md runs; broken ones say so in one line."""

import csv
import importlib.metadata
import re
import shlex
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from radard.cli import main
from radard.config.sink_table import SinkOptions
from radard.errors import FeatureError, ModelMismatch
from radard.judge.features import FeatureSettings, FeatureStream, feature_shape
from radard.outputs.base import SinkContext
from radard.outputs.registry import make_output
from radard.stream.source import open_source
from tests.radar_helpers import decisions, dwell_of, noise, run_radard
from x2radar.errors import PluginError, SceneError
from x2radar.plugins import find_plugin, plugin_names
from x2radar.sim.scene.scene import parse_scene
from x2train.cli import main as train_export
from x2train.sets.families import LABELS, plugged_family
from x2train.sets.passages import play
from x2train.sets.sites import X2, draw_site
from x2train.sets.window_set import load_windows

FOLDER = Path(__file__).parents[2] / "docs" / "research"
PAGE = (FOLDER / "extending.md").read_text()
EXAMPLES = {path.stem: path.read_text() for path in (FOLDER / "examples").glob("*.py")}
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def offer(folder, points, name="example", **files):
    """Lay a distribution into a folder, as pip would."""
    about = folder / f"{name}-0.1.dist-info"
    about.mkdir(exist_ok=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    lines = []
    for group, entries in points.items():
        lines += [f"[{group}]", *(f"{key} = {value}" for key, value in entries.items())]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for module, text in files.items():
        (folder / f"{module}.py").write_text(text)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder on sys.path, empty; what is imported from it is forgotten again."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    known = set(sys.modules)
    yield tmp_path
    for module in set(sys.modules) - known:
        if getattr(sys.modules[module], "__file__", None) and str(tmp_path) in str(
            sys.modules[module].__file__
        ):
            del sys.modules[module]


@pytest.fixture
def page(folder):
    """The examples of the page, installed."""
    points = {}
    for kind, text in BLOCKS:
        if kind == "toml":
            points.update(tomllib.loads(text)["project"]["entry-points"])
        elif head := re.match(r"# (\w+\.yaml)\n", text):
            (folder / head[1]).write_text(text)
    assert sorted(re.findall(r'^--8<-- "(\w+)\.py"$', PAGE, re.MULTILINE)) == sorted(EXAMPLES)
    offer(folder, points, **EXAMPLES)
    assert len(points) == len(EXAMPLES) == 4
    return folder


def shell(word, command="radard"):
    """Arguments of the page's command that holds a word."""
    lines = [line for kind, text in BLOCKS if kind == "sh" for line in text.splitlines()]
    (line,) = [line for line in lines if word in line]
    program, *arguments = shlex.split(line)
    assert program == command
    return arguments


def test_source(page):
    (script,) = [t for kind, t in BLOCKS if kind == "python" and not t.startswith("--8<--")]
    exec(script, {"np": np})  # noqa: S102 - our own page
    code, records, err = run_radard(*shell("npy:"))
    assert (code, err) == (0, "")
    assert records[0]["device"] == "frames.npy"
    assert [d["gate"] for d in decisions(records)] == ["closed"] * 5
    code, _, err = run_radard("--port", "npy:gone.npy")
    assert code == 2
    assert "npy:gone.npy" in err


def test_sink(page):
    code, _, err = run_radard(*shell("csv:"))
    assert (code, err) == (0, "")
    with Path("night.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert len(rows) == 10
    assert {row[2] for row in rows} <= {"open", "closed"}
    code, _, err = run_radard("--port", "sim:empty", "-o", "csv:no/folder.csv")
    assert code == 1
    assert "-o csv:no/folder.csv" in err


def test_feature(page):
    settings = FeatureSettings()
    assert feature_shape("range_power", settings) == (40,)
    dwell = dwell_of(noise(147) * (1 + 9 * (np.arange(64) == 40)))
    features = FeatureStream(settings, ("range_power", "thesis_type1")).extract(dwell)
    assert set(features) == {"range_power", "thesis_type1"}
    where_m = settings.near_m + settings.cell_m * (np.argmax(features["range_power"]) + 0.5)
    assert where_m == pytest.approx(dwell.axis.range_m[40], abs=0.1)
    alone = FeatureStream(settings, ("range_power",)).extract(dwell)
    np.testing.assert_array_equal(alone["range_power"], features["range_power"])


def test_body(page):
    code, records, err = run_radard(*shell("pendulum.yaml"))
    assert (code, err) == (0, "")
    opened = [d for d in decisions(records) if d["gate"] == "open"]
    assert opened
    assert all(1.2 < d["range_m"] < 3.0 for d in opened)
    with pytest.raises(SceneError, match=r"steps\[0\]\.colour: unknown key"):
        parse_scene("steps: [{body: pendulum, duration_s: 1, colour: 1}]", "x", "x")


def test_windows_of_a_body(page, capsys):
    try:
        assert train_export(shell("--families", "train-export")) == 0
        windows, (about,) = load_windows(Path("sets/pendulum"))
        rng, site = np.random.default_rng(3), draw_site(np.random.default_rng(0), X2)
        passage = play(rng, site, (plugged_family("pendulum"),), duration_s=3.0)
    finally:
        plugged_family.cache_clear()
    assert about["use"] == "pendulum"
    assert len(set(windows["passage"])) > 1
    assert {LABELS[k] for k in windows["label"]} == {"other"}
    assert set(windows["family"]) == {-1}
    # It hangs 2 m away and swings by 0.3 m; antennas are not at its height.
    assert 1.5 < windows["true_range_m"].min() <= windows["true_range_m"].max() < 3.0
    assert np.abs(passage.truth.velocity_mps).max() < 1.2
    assert (passage.truth.snr_db > 3).any()
    capsys.readouterr()
    assert train_export(["dataset", "--families", "pendulums", "--out", "sets/x"]) == 2
    assert "'pendulums': neither a use nor a plug-in body; known" in capsys.readouterr().err


BODY = """
import numpy as np
from x2radar.sim.scene.cast import BodyKind
from x2radar.sim.points import Points
class Odd:
    label, names = {label!r}, ('a', 'b')
    def at(self, t_s, antenna_m):
        return Points(np.zeros((len(t_s), {n}, 3)), np.zeros((len(t_s), {n})))
thing = BodyKind('Odd.', lambda rng, options, where: {made})
"""


def body(**change):
    return BODY.format(**{"label": "pet", "n": 2, "made": "Odd()", **change})


def feature(made):
    return (
        "import numpy as np\nclass Odd:\n def shape(self, s): return (3,)\n"
        f" def extract(self, dwell, s): return {made}\nthing = Odd()\n"
    )


def use(group):
    """Make the daemon, or the simulator, use the plug-in `odd` of a group."""
    if group == "sources":
        open_source("odd:x")
    elif group == "sinks":
        make_output("odd:x", SinkOptions(), SinkContext())
    elif group == "features":
        feature_shape("odd", FeatureSettings())
        FeatureStream(FeatureSettings(), ("odd",)).extract(dwell_of(noise(147)))
    else:
        parse_scene("steps: [{body: odd, duration_s: 1}]", "x", "x")


BROKEN = [
    ("sources", "", "cannot be loaded: AttributeError"),
    ("sources", "import nothing_like_this", "cannot be loaded: ModuleNotFoundError"),
    ("sources", "raise RuntimeError('two\\nlines')", "cannot be loaded: RuntimeError: two lines"),
    ("sources", "thing = 3", "TypeError: 'int' object is not callable"),
    ("sources", "def thing(target, options, *, speed): return 3", "int has no stream, is_live"),
    ("sources", "def thing(target, options, *, speed): 1 / 0", "ZeroDivisionError: division"),
    ("sinks", "def thing(url, options, context): return 3", "int has no name, state, waits"),
    ("features", "class thing: pass", "has no shape, extract"),
    ("features", feature("np.zeros(3)"), r"gives float64 \(3,\), not float32 \(3,\)"),
    ("bodies", body(label="ghost"), "label 'ghost' is none of human, pet, other"),
    ("bodies", body(n=3), "2 points at two times have positions of shape"),
    ("bodies", body(made="1 / 0"), "ZeroDivisionError"),
    ("bodies", "thing = 3", "must be a BodyKind, not int"),
]


@pytest.mark.parametrize(("group", "text", "words"), BROKEN)
def test_a_broken_plug_in_is_one_line(group, text, words, folder):
    package = "x2radar" if group == "bodies" else "radard"
    offer(folder, {f"{package}.{group}": {"odd": "odd:thing"}}, odd=text)
    with pytest.raises((PluginError, FeatureError), match=words) as caught:
        use(group)
    assert "\n" not in str(caught.value)


def test_a_command_ends_with_78_and_a_sources_own_errors_pass(folder, capsys):
    offer(folder, {"radard.sources": {"odd": "odd:thing"}}, odd="thing = 3")
    assert main(["--port", "odd:x"]) == 78
    told = "radard: plug-in 'odd' of radard.sources (example): TypeError"
    assert capsys.readouterr().err.startswith(told)
    text = (
        "from x2radar.errors import PortNotFound\n"
        "def other(target, options, *, speed): raise PortNotFound('nothing there')\n"
    )
    offer(folder, {"radard.sources": {"own": "own:other"}}, own=text)
    assert main(["--port", "own:x"]) == 66
    assert capsys.readouterr().err == "radard: nothing there\n"


def test_two_of_one_name_are_refused_and_the_same_twice_is_not(folder):
    points = {"radard.sinks": {"odd": "odd:thing"}}
    offer(folder, points, odd="thing = 1\nother = 2\n")
    offer(folder, points, name="again")
    assert find_plugin("radard.sinks", "odd").made == 1
    offer(folder, {"radard.sinks": {"odd": "odd:other"}}, name="third")
    with pytest.raises(PluginError, match="several offer it: "):
        find_plugin("radard.sinks", "odd")
    assert plugin_names("radard.sinks") == ("odd",)


def test_unknown_names_stay_what_they_were(folder, capsys):
    assert find_plugin("radard.sources", "odd") is None
    assert main(["--port", "odd:x"]) == 66
    assert main(["--port", "sim:empty", "-o", "odd:x"]) == 2
    assert "unknown or incomplete" in capsys.readouterr().err
    with pytest.raises(ModelMismatch, match="feature 'odd': unknown"):
        feature_shape("odd", FeatureSettings())
    with pytest.raises(SceneError, match="no body 'odd'; known are human"):
        parse_scene("steps: [{body: odd, duration_s: 1}]", "x", "x")


TAKEN = {"sources": ["sim", "replay"], "sinks": ["json", "null"], "features": ["thesis_type1"]}


def test_built_in_names_cannot_be_taken(folder):
    points = {f"radard.{kind}": dict.fromkeys(names, "odd:thing") for kind, names in TAKEN.items()}
    points["x2radar.bodies"] = {"human": "odd:thing"}
    offer(folder, points, odd="raise RuntimeError('was loaded')")
    argv = ("--port", "sim:human", "--speed", "max", "--duration", "4", "-o", "json")
    code, records, _ = run_radard(*argv)
    assert code == 0
    assert len(decisions(records)) == 2


@pytest.mark.integration
def test_nobody_looks_for_plug_ins_without_need(monkeypatch, tmp_path):
    def never(**_kwargs):
        pytest.fail("the path to the first decision looked for plug-ins")

    monkeypatch.setattr(importlib.metadata, "entry_points", never)
    argv = ["--port", "sim:human", "--speed", "max", "--duration", "4"]
    code, records, err = run_radard(*argv, "-o", "json", "-o", f"json:{tmp_path / 'x'}")
    assert (code, err) == (0, "")
    assert len(decisions(records)) == 2
    assert run_radard("--port", str(tmp_path / "gone"))[0] == 66
    with pytest.raises(Exception, match="socket://"):
        open_source("socket://127.0.0.1:1")
