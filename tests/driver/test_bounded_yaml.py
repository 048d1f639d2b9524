"""YAML with bounds: read as safe_load reads it; a key twice is an error with both lines."""

import contextlib
import pickle

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from radard.config.config import load_config
from radard.errors import ConfigError, RadardError
from x2radar.bounded_yaml import MAX_NODES, YamlError, load_yaml
from x2radar.errors import SceneError, SettingsError, X2RadarError
from x2radar.sim.scene.scene import load_scene

TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=5)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | TEXTS,
    lambda of: st.lists(of, max_size=3) | st.dictionaries(TEXTS, of, max_size=3),
    max_leaves=10,
)


@given(VALUES, st.sampled_from([True, False, None]))
def test_it_reads_what_yaml_writes(value, flow):
    assert load_yaml(yaml.safe_dump(value, default_flow_style=flow)) == value


@pytest.mark.parametrize(
    ("text", "key", "lines"),
    [
        ("hall: {port: a}\nporch: {port: b}\nhall: {port: c}\n", "hall", "1 and 3"),
        ("alarm: {}\n\nalarm: {}\n", "alarm", "1 and 3"),
        ("a: {b: 1, b: 2}\n", "b", "1 and 1"),
        ("- {x: 1,\n   'x': 2}\n", "x", "1 and 2"),
        ("a:\n  - b:\n      c: 1\n      d: 1\n      c: 1\n", "c", "3 and 5"),
        ("base: &base {k: 1}\na: {<<: *base, <<: *base}\n", "<<", "2 and 2"),
    ],
)
def test_a_key_that_stands_twice_is_named_with_both_lines(text, key, lines):
    with pytest.raises(YamlError) as caught:
        load_yaml(text)
    assert caught.value.problem == f"the key '{key}' stands twice, in lines {lines}"
    assert caught.value.line == int(lines.split()[-1])


def test_the_same_key_in_two_mappings_and_over_a_merged_one_is_none_twice():
    text = "a: &a {k: 1}\nb: {<<: *a, k: 2}\nc: [{k: 1}, {k: 2}]\n"
    assert load_yaml(text) == {"a": {"k": 1}, "b": {"k": 2}, "c": [{"k": 1}, {"k": 2}]}


BOMB = "a: &a [1, 1]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join(['*' + chr(97 + n)] * 20)}]\n" for n in range(4)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, f"more than {MAX_NODES} values"),
        ("a: &a [*a]", "an alias to what it stands in"),
        ("a: " + "1" * 20_000, "a value of 20000 characters"),
        ("#" * 300_000, "longer than the"),
        ("[" * 5000, "nested too deeply"),
        ("a: 2026-13-45", "does not suit its tag or kind"),
        ("!!int {a: 1}", "expected a scalar node"),
        ("!!python/object/apply:os.getcwd []", "could not determine a constructor"),
        ("a: [", "expected the node content"),
        ("a\0b: 1\n", "special characters are not allowed"),
        (r'a: ["x", "/var/\0lib"]', "line 1: a NUL character"),
        ("{[]: 1}", "found unhashable key"),
        ("? &a [*a]\n: 1", "an alias to what it stands in"),
        ("a: 1" + ":1" * 6000, "a value of 12001 characters"),
        ("a: &a {b: 1}\nc: [{<<: [" + "*a, " * 20_000 + "*a]}]", f"more than {MAX_NODES} values"),
        ("a: !!binary 1", "failed to decode base64 data"),
    ],
)
def test_what_is_no_yaml_or_too_much_is_one_kind_of_error(text, problem):
    with pytest.raises(YamlError, match=problem) as caught:
        load_yaml(text)
    assert "\n" not in str(caught.value)


def test_a_file_without_an_end_is_refused(tmp_path):
    """As a recording that was named by mistake: all of it was read first."""
    path = tmp_path / "a.yaml"
    path.symlink_to("/dev/zero")
    with pytest.raises(ConfigError, match="longer than the"):
        load_config(path)
    with pytest.raises(SceneError, match="longer than the"):
        load_scene(str(path))


@given(st.text(alphabet="ab:{}[]&*!-#'\"\n 1<>|%~", max_size=60))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(YamlError):
        load_yaml(text)


def test_messages_stay_short_whatever_they_quote(tmp_path):
    """Found by fuzzing: a message was as long as the file made it."""
    path = tmp_path / "a.yaml"
    long = "output: " + "[" * 500 + "x" * 500 + "]" * 500
    for text in (BOMB, long, "".join(f"key{k}: 1\n" for k in range(3000)), "k" * 5000 + ": 1\n"):
        path.write_text(text)
        with pytest.raises(ConfigError) as config:
            load_config(path, environ={})
        with pytest.raises(SceneError) as scene:
            load_scene(str(path))
        for caught in (config, scene):
            assert len(str(caught.value)) <= 2000
            assert str(caught.value).startswith(str(path))
    for kind in (X2RadarError, RadardError, SettingsError):
        long = kind("begin " + "x" * 9000 + " end")
        assert str(long).startswith("begin x")
        assert str(long).endswith("x end")
        assert " ... " in str(long)
        assert len(str(long)) == 2000
        assert str(pickle.loads(pickle.dumps(long))) == str(long)  # noqa: S301 - our own
        assert str(kind("a" * 2000)) == "a" * 2000
