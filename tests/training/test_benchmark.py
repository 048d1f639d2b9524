"""The benchmark: its tasks, its entries, what counts, and its page."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from radard.errors import UsageError
from research.benchmark import entrants, results_page
from research.benchmark.entries import svm_hand_features, thesis_network
from research.benchmark.scoring import Kept, score
from research.benchmark.tasks import VERSION, Elements, Task, tasks_named
from x2train.cli import main
from x2train.thesis.cells import CELLS
from x2train.thesis.settings import fit_settings

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "benchmark.md"
TINY = Task(CELLS[0], 40, 40)


def told(*_):
    pass


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
    in_view = np.ones(n, np.float32)
    return Elements(vector, mu, range_time, is_person, in_view, 60)


def test_the_data_is_what_it_says(folder):
    train, test = TINY.train(folder), TINY.test(folder)
    assert train.vector.shape == (40, 784)
    assert train.mu.shape == (40, 28, 40)
    assert train.range_time.shape == (40, 56, 40)
    assert train.is_person.tolist() == [False, True] * 20
    assert not np.array_equal(train.mu, test.mu)
    assert 0 < train.mu.max() <= 1
    again = replace(TINY, n_train=42)
    again.make(folder, told)
    assert np.array_equal(again.train(folder).mu[:40], train.mu)


@pytest.mark.parametrize("name", entrants.shipped())
def test_an_entry_learns_what_is_easy(name, easy, monkeypatch):
    small = fit_settings("relu", pretrain_epochs=(), output_epochs=0, epochs=20, look_every=10)
    few = replace(small, repeats=1)
    monkeypatch.setattr(thesis_network, "fit_settings", lambda *_args, **_own: few)
    entry = entrants.import_module(f"{entrants.entries.__name__}.{name}")
    p = np.asarray(entry.scores(easy, easy, 0))
    assert p.shape == (120,)
    assert ((p > 0.5) == easy.is_person).mean() > 0.9
    assert "ource:" in entry.__doc__
    assert entry.TITLE


def test_hand_features_are_what_they_are_called(easy):
    made = svm_hand_features.hand_features(easy)
    assert made.shape == (120, 6)
    torso, width = made[:, 0], made[:, 1]
    assert np.abs(torso - 14).max() <= 1
    assert width[easy.is_person].min() > 18
    assert width[~easy.is_person].max() < 4


def test_what_counts(easy):
    truth = easy.is_person.astype(float)
    perfect = score(TINY, ("a", "A"), 0, truth, easy)
    assert (perfect.accuracy, perfect.auc) == (1.0, 1.0)
    assert perfect.cross_entropy < 1e-4
    assert perfect.low < 1 == perfect.high
    coin = score(TINY, ("a", "A"), 0, np.full(120, 0.5), easy)
    assert (coin.auc, coin.cross_entropy) == (0.5, 0.6931)
    half_right = np.where(np.arange(120) < 60, truth, 1 - truth)
    assert score(TINY, ("a", "A"), 0, half_right, easy).accuracy == 0.5
    for wrong in (truth[:5], truth * 2, np.full(120, np.nan)):
        with pytest.raises(UsageError, match="wants 120 probabilities"):
            score(TINY, ("a", "A"), 0, wrong, easy)


def test_an_entry_does_not_see_the_truth(folder, tmp_path):
    (tmp_path / "peek.py").write_text(
        "def scores(train, test, seed):\n    return test.is_person * 1.0\n"
    )
    entrant = entrants.entrant_named(str(tmp_path / "peek.py"))
    p = entrant.run(TINY, folder, 0)
    assert score(TINY, ("peek", ""), 0, p, TINY.test(folder)).accuracy == 0.5


@pytest.mark.parametrize("name", ["spectrogram_cnn", "svm_hand_features", "two_maps"])
def test_who_does_not_look_at_the_vector_gets_none(name, folder):
    module = entrants.import_module(f"{entrants.entries.__name__}.{name}")
    assert not module.USES_VECTOR
    seen = []

    def scores(train, test, _seed):
        seen.append((train.vector.shape, test.vector.shape))
        return np.full(len(test), 0.5)

    run = entrants._trained(scores, uses_vector=False)
    run(TINY, folder, 0)
    run(Task(CELLS[2], 40, 40), folder, 0)
    assert seen == [((40, 0), (40, 0))]


def test_the_example_of_the_page_is_an_entry(folder, tmp_path):
    codes = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (code,) = (each for each in codes if "def scores" in each)
    (tmp_path / "mine.py").write_text(code)
    entrant = entrants.entrant_named(str(tmp_path / "mine.py"))
    assert entrant.title == "mean speed, one threshold"
    assert score(TINY, ("mine", ""), 0, entrant.run(TINY, folder, 0), TINY.test(folder))


def test_a_bundle_is_judged_as_it_is(folder, monkeypatch):
    entrant = entrants.entrant_named("fast")
    p = entrant.run(TINY, folder, 0)
    assert entrant.kept_as.startswith("fast-")
    # The task that differs in the vector alone is not judged again.
    monkeypatch.delattr(entrants, "_test_dwells")
    np.testing.assert_array_equal(entrant.run(Task(CELLS[2], 40, 40), folder, 0), p)
    assert p.shape == (40,)
    assert 0 <= p.min() <= p.max() <= 1
    assert np.ptp(p) > 0.1


@pytest.mark.parametrize(
    ("text", "said"),
    [("gone.py", "no such file"), ("there.py:other", "has no function 'other'")],
)
def test_what_is_no_entry_is_said(tmp_path, monkeypatch, text, said):
    monkeypatch.chdir(tmp_path)
    Path("there.py").write_text("scores = len")
    with pytest.raises(UsageError, match=said):
        entrants.entrant_named(text)


def test_tasks_by_name():
    assert len(tasks_named(None, 40, 40)) == 8
    with pytest.raises(UsageError, match="task 'T9': known are T1D60"):
        tasks_named("T1D60,T9", 40, 40)
    with pytest.raises(UsageError, match="n_train 41: must be even"):
        tasks_named("T1D60", 41, 40)


def test_the_command_and_its_page(folder, tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{results_page.RESULTS[0]}\nold\n{results_page.RESULTS[1]}\nbehind\n")
    (tmp_path / "half.py").write_text(
        "import numpy as np\ndef scores(train, test, seed):\n    return np.full(len(test), 0.25)\n"
    )
    (tmp_path / "data").symlink_to(folder)
    argv = ["benchmark", "--folder", str(tmp_path), "--elements", "40", "--fresh", "40"]
    argv += ["--tasks", "T1D60", "--workers", "1", "--publish", str(page)]
    argv += ["--entry", "svm_hand_features", "--entry", str(tmp_path / "half.py")]
    assert main(argv) == 0
    assert "T1D60 half: 50.0 %" in capsys.readouterr().out
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("behind\n")
    assert "old" not in text
    assert f"Version `{VERSION}`, 40 elements to train with" in text
    assert "**small: the full task has 5000 of each**" in text
    assert "| half (`half`) | 50.0 | 50.0 |" in text
    kept = Kept(tmp_path / "scores").load(TINY, "half", 0)
    assert kept is not None
    assert json.loads(json.dumps(kept.accuracy)) == 0.5
    page.write_text("no marks")
    assert main(argv) == 2


def test_what_earlier_runs_left_is_published_by_itself(easy, tmp_path, capsys):
    kept = Kept(tmp_path / "scores")
    p = np.where(easy.is_person, 0.9, 0.2)

    def save(entry, cell, n, *, right=True):
        task = Task(cell, n, n)
        kept.save(task, entry, score(task, (entry, entry), 0, p if right else 1 - p, easy))

    for cell in CELLS:
        save("good", cell, 5000)
        save("good", cell, 400, right=False)
        save("quick", cell, 400)
    save("quick", CELLS[0], 5000)
    argv = ["benchmark", "--folder", str(tmp_path), "--kept"]
    assert main(argv) == 0
    told = capsys.readouterr().out
    assert "5000 elements to train with, 5000 fresh ones that judge." in told
    assert "| good (`good`) | 100.0 |" in told
    # One task at full size is less than eight.
    assert "| quick (`quick`), with 400 and 400 elements | 100.0 |" in told
    assert main([*argv, "--seed", "7"]) == 2
    assert "with seed 7 are kept" in capsys.readouterr().err


def test_the_results_of_the_page_are_of_this_version():
    text = (
        PAGE.read_text()
        .partition(results_page.RESULTS[0])[2]
        .partition(results_page.RESULTS[1])[0]
    )
    assert f"Version `{VERSION}`" in text
    for name in entrants.shipped():
        assert f"(`{name}`)" in text
