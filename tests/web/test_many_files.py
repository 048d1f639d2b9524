"""A process that may open no more files: decisions go on, it is said once, and pages come back."""

import contextlib
import resource
import signal
import socket
import urllib.request

import pytest

from tests.processes import started
from tests.waiting import free_port, wait_for

_MAX_FILES = 48


@pytest.mark.integration
def test_more_pages_and_commands_than_files(tmp_path):
    port, out = free_port(), tmp_path / "out.jsonl"
    options = ["--port", "sim:empty", "--speed", "4", "--model", "none", "--state", tmp_path]
    outputs = ["-o", f"json:{out}", "-o", f"http://127.0.0.1:{port}"]
    limits = (resource.RLIMIT_NOFILE, (_MAX_FILES, _MAX_FILES))
    said = (tmp_path / "said").open("w+")
    daemon = started(
        *("-m", "radard", *options, *outputs),
        stdout=said,
        stderr=said,
        preexec_fn=lambda: resource.setrlimit(*limits),
    )

    def n_decisions():
        return out.read_text().count('"type":"decision"') if out.exists() else 0

    def is_well():
        with contextlib.suppress(OSError):
            return urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=2)
        return False

    try:
        wait_for(is_well)
        lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(_MAX_FILES + 20)]
        seen = n_decisions()
        wait_for(lambda: n_decisions() > seen + 20)
        for line in lines:
            line.close()
        wait_for(is_well)
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(20) == 0
    finally:
        daemon.kill()
        daemon.wait()
    said.seek(0)
    told = said.read().splitlines()
    said.close()
    assert sum("no further page can be opened" in line for line in told) == 1, told
    assert len(told) < 20, told
