import time
from itertools import islice
from urllib.parse import quote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.device.link import Deadlines
from x2radar.errors import ReadTimeout, SceneError, SettingsError
from x2radar.ports import Port, parse_port
from x2radar.radars import make_radar
from x2radar.sim.module.stream import EchoStream


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("/dev/ttyACM0", Port("live", "/dev/ttyACM0", {})),
        ("/dev/ttyS1?rate=200", Port("live", "/dev/ttyS1", {"rate": "200"})),
        ("sim:human", Port("sim", "human", {})),
        ("sim:human?seed=1&kind=rf", Port("sim", "human", {"seed": "1", "kind": "rf"})),
        ("replay:a.h5?start=12&loop=1", Port("replay", "a.h5", {"start": "12", "loop": "1"})),
        ("sim:x?fault=a:1,b:2", Port("sim", "x", {"fault": "a:1,b:2"})),
        ("auto?rate=20", Port("auto", "auto", {"rate": "20"})),
        ("socket://[::1]:7000", Port("live", "socket://[::1]:7000", {})),
        ("loop://", Port("live", "loop://", {})),
    ],
)
def test_parsing(text, spec):
    assert parse_port(text) == spec


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("sim:human?seed", "key=value pairs joined by '&'"),
        ("sim:human?seed=1&s%65ed=2", "a key is given twice"),
        ("sim:?seed=1", "nothing behind 'sim:'"),
        ("", "no port"),
    ],
)
def test_strings_that_are_no_port(text, wanted):
    with pytest.raises(SettingsError, match=wanted) as caught:
        parse_port(text)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "url",
    [
        *("socket://127.0.0.1", "socket://h:99999", "socket://h:x", "socket://a b:7000"),
        *("socket://h:7000/path", "socket://[::1:7000", "rfc2217://h", "spy://", "tcp://h:1"),
        "://h:1",
    ],
)
def test_urls_that_nothing_can_be_behind_end_with_78(url):
    """Where they were opened first, --wait waited for ever, and pyserial's words were shown."""
    with pytest.raises(SettingsError) as caught:
        parse_port(url)
    assert caught.value.exit_code == 78
    assert str(caught.value).startswith(f"port '{url.partition('?')[0]}': ")
    assert "\n" not in str(caught.value)


@given(st.text(min_size=1, max_size=40))
def test_any_text_is_a_port_or_a_settings_error(text):
    try:
        spec = parse_port(text)
    except SettingsError:
        return
    assert spec.kind in {"sim", "replay", "live", "auto"}
    assert spec.target


# A lone surrogate has no encoding.
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@given(TEXTS.filter(bool), TEXTS)
def test_percent_encoding_carries_any_text(target, value):
    text = f"sim:{quote(target, safe='')}?seed={quote(value, safe='')}"
    assert parse_port(text) == Port("sim", target, {"seed": value})


@pytest.mark.parametrize(
    ("port", "error", "wanted"),
    [
        ("sim:human?speed=2", SettingsError, "'speed': unknown; known are device, fault, kind, r"),
        ("/dev/ttyACM0?seed=1", SettingsError, "'seed': unknown; known are device, kind, rate"),
        ("sim:human?rate=fast", SettingsError, "port key 'rate': 'fast' is not a number"),
        ("sim:human?rate=0", SettingsError, "frame_rate_hz = 0.0"),
        ("sim:human?rate=nan", SettingsError, "'nan' is not a number"),
        ("sim:human?kind=iq", SettingsError, "port key 'kind': 'iq'; known are rf, baseband"),
        ("sim:human?seed=-1", SettingsError, "port key 'seed': '-1' must be a whole number"),
        ("sim:human?seed=" + "9" * 30, SettingsError, "port key 'seed'"),
        ("sim:nobody", SceneError, "no scene 'nobody'"),
        ("replay:human", SettingsError, "a recording is no radar"),
    ],
)
def test_faults_come_before_anything_is_opened(port, error, wanted):
    with pytest.raises(error, match=wanted) as caught:
        make_radar(parse_port(port))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fault", ["", "?fault=spike:0.1"])
def test_a_module_paced_by_its_reader_is_never_taken_for_silent(monkeypatch, fault):
    """Among a hundred others its thread may be late; a reset would make it later still."""
    plain, calls = EchoStream.next, []

    def late(self):
        calls.append(1)
        if len(calls) == 500:
            time.sleep(2.0)
        return plain(self)

    monkeypatch.setattr(EchoStream, "next", late)
    short = Deadlines(stall_s=0.5)
    monkeypatch.setattr("x2radar.device.device.Deadlines", lambda: short)
    with make_radar(parse_port(f"sim:empty{fault}"), speed=None) as radar:
        if fault:
            with pytest.raises(ReadTimeout, match="no frame"):
                list(islice(radar.frames(), 600))
        else:
            assert not any(frame.restarted for frame in islice(radar.frames(), 1, 600))
