"""The benchmark: its tasks, its entries, what counts, and its page."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import benchmark
import benchmark_tasks as tasks
from benchmark_alarms import (
    MARKS,
    AlarmFunction,
    FunctionSpec,
    alarm_entrant,
    default_entries,
    play,
)
from benchmark_tasks import (
    ENTRIES,
    VERSION,
    Elements,
    Entrant,
    Kept,
    Task,
    entrant_named,
    module_of,
    score,
    tasks_named,
)
from radard.errors import UsageError
from study import RESULTS
from x2train.judge import acceptance, acceptance_report
from x2train.judge.acceptance import ENTRIES as ACCEPT_ENTRIES
from x2train.judge.acceptance import VERSION as ACCEPT
from x2train.thesis.cells import CELLS
from x2train.thesis.fit import fit_settings

pytestmark = pytest.mark.nightly
PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"
TINY = Task(CELLS[0], 40, 40)
SHORT = {"walk test": 8.0, "pets cross": 8.0, "pets stay": 30.0, "thing": 8.0}


def told(*_):
    pass


def entrant(name):
    return Entrant(name, name, told)


def code_of_page(wanted):
    codes = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (code,) = (each for each in codes if wanted in each)
    return code


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The data of T1D60, 40 elements and 40 that judge."""
    made = tmp_path_factory.mktemp("benchmark")
    TINY.make(made, told)
    return made


@pytest.fixture(scope="module")
def easy():
    """Elements that a look tells apart: people are bright at high velocities."""
    rng = np.random.default_rng(0)
    n = 120
    is_person = np.arange(n) % 2 == 1
    mu = rng.uniform(0, 0.2, (n, 28, 40)).astype(np.float32)
    mu[is_person, 4:24] = 0.8
    mu[:, 13:16] = 0.9
    vector = np.repeat(mu.mean(axis=2), 28, axis=1).astype(np.float32)
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    range_time = rng.uniform(0, 1, (n, 56, 40)).astype(np.float32)
    return Elements(vector, mu, range_time, is_person, np.ones(n, np.float32), 60)


@pytest.mark.parametrize("name", tasks.shipped())
def test_an_entry_learns_what_is_easy(name, easy):
    entry = module_of(tasks.entry_file(name))
    if name == "thesis_network":
        small = fit_settings("relu", pretrain_epochs=(), output_epochs=0, epochs=20, look_every=10)
        entry.fit_settings = lambda *_args, **_own: replace(small, repeats=1)
    p = np.asarray(entry.scores(easy, easy, 0))
    assert p.shape == (120,)
    assert ((p > 0.5) == easy.is_person).mean() > 0.9
    assert "ource:" in entry.__doc__
    assert entry.TITLE
    if name == "svm_hand_features":
        torso, width = entry.hand_features(easy)[:, :2].T
        assert np.abs(torso - 14).max() <= 1
        assert width[easy.is_person].min() > 18
        assert width[~easy.is_person].max() < 4


def test_what_counts(easy):
    truth, a = easy.is_person.astype(float), entrant("a")
    perfect = score(TINY, a, 0, truth, easy)
    assert (perfect.accuracy, perfect.auc) == (1.0, 1.0)
    assert perfect.cross_entropy < 1e-4
    assert perfect.low < 1 == perfect.high
    coin = score(TINY, a, 0, np.full(120, 0.5), easy)
    assert (coin.auc, coin.cross_entropy) == (0.5, 0.6931)
    half_right = np.where(np.arange(120) < 60, truth, 1 - truth)
    assert score(TINY, a, 0, half_right, easy).accuracy == 0.5
    for wrong in (truth[:5], truth * 2, np.full(120, np.nan)):
        with pytest.raises(UsageError, match="wants 120 probabilities"):
            score(TINY, a, 0, wrong, easy)


def test_an_entry_sees_neither_the_truth_nor_a_vector_it_does_not_use(folder):
    seen = []

    def peek(train, test, _seed):
        seen.append((train.vector.shape, test.vector.shape))
        return test.is_person * 1.0

    p = tasks.trained(peek, uses_vector=True)(TINY, folder, 0)
    assert score(TINY, entrant("peek"), 0, p, TINY.test(folder)).accuracy == 0.5
    run = tasks.trained(peek, uses_vector=False)
    run(TINY, folder, 0)
    # Tasks that differ in the vector alone are the same to it.
    run(Task(CELLS[2], 40, 40), folder, 0)
    assert seen == [((40, 784), (40, 784)), ((40, 0), (40, 0))]


def test_the_example_of_the_page_is_an_entry(folder, tmp_path):
    (tmp_path / "mine.py").write_text(code_of_page("def scores"))
    made = entrant_named(str(tmp_path / "mine.py"))
    assert made.title == "mean speed, one threshold"
    assert score(TINY, made, 0, made.run(TINY, folder, 0), TINY.test(folder))


def test_a_bundle_is_judged_as_it_is(folder, monkeypatch):
    made = entrant_named("fast")
    p = made.run(TINY, folder, 0)
    assert made.kept_as.startswith("fast-")
    monkeypatch.delattr(tasks, "test_dwells")
    np.testing.assert_array_equal(made.run(Task(CELLS[2], 40, 40), folder, 0), p)
    assert p.shape == (40,)
    assert 0 <= p.min() <= p.max() <= 1
    assert np.ptp(p) > 0.1


def test_the_script_and_its_page(folder, tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{RESULTS[0]}\nOLD\n{RESULTS[1]}\nbehind\n")
    (tmp_path / "half.py").write_text(
        "import numpy as np\ndef scores(train, test, seed):\n    return np.full(len(test), 0.25)\n"
    )
    (tmp_path / "data").symlink_to(folder)
    argv = ["--folder", str(tmp_path), "--elements", "40", "--fresh", "40"]
    argv += ["--tasks", "T1D60", "--workers", "1", "--publish", str(page)]
    argv += ["--entry", "svm_hand_features", "--entry", str(tmp_path / "half.py")]
    assert benchmark.main(argv) == 0
    assert "T1D60 half: 50.0 %" in capsys.readouterr().out
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("behind\n")
    assert "OLD" not in text
    assert f"Version `{VERSION}`, 40 elements to train with" in text
    assert "**small: the full task has 5000 of each**" in text
    assert "| half (`half`) | 50.0 | 50.0 |" in text
    assert Kept(tmp_path / "scores").load(TINY, "half", 0).accuracy == 0.5


def test_what_earlier_runs_left_is_published_by_itself(easy, tmp_path, capsys):
    kept = Kept(tmp_path / "scores")
    p = np.where(easy.is_person, 0.9, 0.2)

    def save(name, cell, n, *, right=True):
        task = Task(cell, n, n)
        kept.save(task, name, score(task, entrant(name), 0, p if right else 1 - p, easy))

    for cell in CELLS:
        save("good", cell, 5000)
        save("good", cell, 400, right=False)
        save("quick", cell, 400)
    save("quick", CELLS[0], 5000)
    argv = ["--folder", str(tmp_path), "--kept"]
    assert benchmark.main(argv) == 0
    shown = capsys.readouterr().out
    assert "5000 elements to train with, 5000 fresh ones that judge." in shown
    assert "| good (`good`) | 100.0 |" in shown
    # One task at full size is less than eight.
    assert "| quick (`quick`), with 400 and 400 elements | 100.0 |" in shown
    assert benchmark.main([*argv, "--seed", "7"]) == 2
    assert "with seed 7 are kept" in capsys.readouterr().err


def test_the_results_of_the_page_are_of_these_versions():
    for (begin, end), version in ((RESULTS, VERSION), (MARKS, ACCEPT)):
        text = PAGE.read_text().partition(begin)[2].partition(end)[0]
        assert f"Version `{version}`" in text
        wanted = tasks.shipped() if version == VERSION else ("any_motion",)
        assert all(f"(`{name}`)" in text for name in wanted)
    assert len(tasks_named(None, 40, 40)) == 8
    assert default_entries()[0] == "any_motion"


# ---------------------------------------------------------------- alarms


@pytest.fixture
def short(monkeypatch):
    """One passage of seconds of each kind."""
    kinds = {entry.kind: entry for entry in ACCEPT_ENTRIES}
    few = tuple(replace(entry, duration_s=SHORT[kind]) for kind, entry in kinds.items())
    for module in (acceptance, acceptance_report):
        monkeypatch.setattr(module, "ENTRIES", few)


def played(text, folder):
    return play(alarm_entrant(text), folder, 0.001, workers=1, tell=told)


def counts(made):
    return [row["bundle"]["count"] for row in made.document["entries"]]


@pytest.mark.usefixtures("short")
def test_functions_and_bundles_judge_the_same_passages(tmp_path):
    (tmp_path / "never.py").write_text(
        "TITLE = 'never'\ndef alarms(windows):\n    for _ in windows:\n        yield False\n"
        "def always(windows):\n    for _ in windows:\n        yield True\n"
    )
    (tmp_path / "near.py").write_text(code_of_page("def alarms"))
    never = played(f"{tmp_path / 'never.py'}", tmp_path)
    always = played(f"{tmp_path / 'never.py'}:always", tmp_path)
    motion, fast = played("any_motion", tmp_path), played("fast", tmp_path)
    near = played(f"{tmp_path / 'near.py'}", tmp_path)
    in_view = [row["in_view"] for row in never.document["entries"]]
    for each in (always, motion, fast, near):
        assert [row["in_view"] for row in each.document["entries"]] == in_view
    # Misses of people, then passages or minutes of others with an alarm.
    assert counts(never) == [in_view[0], 0, 0, 0]
    assert counts(always) == [0, 1, 1, 1]
    assert counts(motion)[:2] == [0, 1]
    assert all(a <= b for a, b in zip(counts(near)[1:], counts(motion)[1:], strict=True))
    assert (never.title, near.title) == ("never (`never`)", "motion within 2 m (`near`)")
    assert (fast.is_bundle, motion.is_bundle) == (True, False)
    assert alarm_entrant("x4m03").title == "bundle `x4m03`, X4M03 alone"


def looks_ahead(windows):
    yield from [True for _ in windows]


def ends(windows):
    yield next(windows) is None


def answers_in_words(windows):
    for _ in windows:
        yield "alarm"


def answers_unasked(_windows):
    yield True


@pytest.mark.parametrize("alarms", [looks_ahead, ends, answers_in_words, answers_unasked])
def test_what_is_no_alarm_is_said(alarms):
    function = AlarmFunction(alarms, "mine.py")
    ahead = "took a window before it had answered"
    said = ahead if alarms is looks_ahead else "must yield True or False for every window"
    with pytest.raises(UsageError, match=f"entry 'mine.py': {said}"):
        list(map(function.is_alarm, [object() for _ in range(3)]))


@pytest.mark.usefixtures("short")
def test_one_command_renews_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{MARKS[0]}\nOLD TABLE\n{MARKS[1]}\nbehind\n")
    argv = ["--tasks", ACCEPT, "--share", "0.001", "--workers", "1"]
    argv += ["--folder", str(tmp_path), "--publish", str(page)]
    argv += ["--entry", "fast", "--entry", "any_motion"]
    assert benchmark.main(argv) == 0
    text = page.read_text()
    assert text.startswith("before\n")
    assert "OLD TABLE" not in text
    assert f"Version `{ACCEPT}`; **a share of 0.001 of the test**." in text
    assert "| bundle `fast` |" in text
    assert "| the same, by single windows at 0.8 |" in text
    assert "| any motion (`any_motion`) | 0 of 1" in text
    assert f"--entry any_motion --tasks {ACCEPT} --share 0.001" in text
    made = sorted(tmp_path.glob(f"{ACCEPT}-*"))
    assert len(made) == 2
    assert all((folder / "acceptance.html").is_file() for folder in made)
    # What is there is not played again.
    times = [(f / "passages" / "manifest.json").stat().st_mtime_ns for f in made]
    assert benchmark.main(argv) == 0
    assert [(f / "passages" / "manifest.json").stat().st_mtime_ns for f in made] == times


PASSAGES = {
    (0, 0): (3.23, 23.85, 2.08, -9.31),
    (1, 3): (0.00, 22.08, 2.74, 1.03),
    (2, 1): (0.00, 34.55, 3.08, 9.49),
    (4, 4): (0.00, 25.43, 2.82, -7.97),
    (6, 0): (9.82, 13.90, 2.33, -13.21),
    (7, 5): (0.00, 10.42, 3.09, -21.49),
    (10, 2): (4.07, 11.88, 2.64, -19.11),
}
"""Passages of the version, by entry and number: entry in s, SNR in dB, range in m, mean power."""


@pytest.mark.parametrize("place", PASSAGES, ids=str)
def test_passages_of_the_version_are_what_they_were(place):
    """Whoever changes the simulator so that they differ gives the test another version."""
    spec = FunctionSpec(model=f"{ENTRIES / 'any_motion.py'}")
    number = sum(e.count for e in ACCEPT_ENTRIES[: place[0]]) + place[1]
    assert spec.entry(number) == place
    made = spec(number)
    shown = [float(made[name][0]) for name in ("enters_s", "snr_db", "range_m")]
    assert [*shown, float(made["power_db"].mean())] == pytest.approx(PASSAGES[place], abs=0.05)
