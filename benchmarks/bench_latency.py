"""How soon a decision is published: from the arrival of a hop's last frame to its subscriber.

A simulated module streams in real time into a pseudo-terminal from a process of its own, which
notes when every frame was written whole. The daemon reads it with MQTT and the SQLite store on;
the broker (mosquitto where installed, else amqtt) is another process, and this one subscribes.
A decision's time is from the write of its last frame to the message in this process, so broker
and subscriber are in it; `daemon` is the share up to the record, as the record itself says.

Also: resident memory of the daemon at the end, and start to first decision: from the start of
its process to its first decision at the subscriber, less the time that the frames of a dwell
take (147 at 60 Hz).
"""

import argparse
import asyncio
import json
import multiprocessing as mp
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import paho.mqtt.client as paho
from amqtt.broker import Broker
from paho.mqtt.enums import CallbackAPIVersion

from x2radar.device.transport import PtyTransport
from x2radar.sim.module.host import serve
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire.framing import Packet, PacketDecoder

DWELL_FRAMES = 147
RATE_HZ = 60.0
_FRAME_BYTES = 200


class Noting:
    """The module's end of a terminal; notes when the last byte of every frame was written."""

    def __init__(self, inner: PtyTransport, times: Any, n_frames: Any) -> None:
        self._inner = inner
        self._times, self._n = times, n_frames
        self._decoder = PacketDecoder()
        self.read, self.close = inner.read, inner.close

    def write(self, data: bytes) -> None:
        """As in `Transport`."""
        self._inner.write(data)
        now_s = time.monotonic()
        for packet in self._decoder.feed(data):
            is_frame = isinstance(packet, Packet) and len(packet.data) > _FRAME_BYTES
            if is_frame and self._n.value < len(self._times):
                self._times[self._n.value] = now_s
                self._n.value += 1


def module_process(scene: str, path: Any, times: Any, n_frames: Any) -> None:
    """Serve the module until killed."""
    pty = PtyTransport()
    path.send(pty.path)
    module = SimulatedModule(load_scene(scene))
    serve(module, Noting(pty, times, n_frames))


def broker_process(port: int) -> None:
    """Serve amqtt until killed."""

    async def body() -> None:
        plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
        listener = {"type": "tcp", "bind": f"127.0.0.1:{port}"}
        await Broker({"listeners": {"default": listener}, "plugins": plugins}).start()
        await asyncio.Event().wait()

    asyncio.run(body())


def start_broker(folder: Path, port: int) -> Any:
    """Return the process of a broker on a port, once it answers."""
    mosquitto = shutil.which("mosquitto")
    process: Any
    if mosquitto:
        conf = folder / "mosquitto.conf"
        conf.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
        process = subprocess.Popen([mosquitto, "-c", str(conf)], stderr=subprocess.DEVNULL)
    else:
        process = mp.get_context("spawn").Process(target=broker_process, args=(port,), daemon=True)
        process.start()
    for _ in range(200):
        with socket.socket() as sock:
            if sock.connect_ex(("127.0.0.1", port)) == 0:
                return process
        time.sleep(0.05)
    msg = "the broker does not answer"
    raise RuntimeError(msg)


class Subscriber:
    """Notes decisions and when they came."""

    def __init__(self, port: int) -> None:
        self.got: list[tuple[float, dict[str, Any]]] = []
        self._ready = threading.Event()
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id="bench")
        topic = "radard/radar/decision"
        self._client.on_connect = lambda *_: self._client.subscribe(topic)
        self._client.on_subscribe = lambda *_: self._ready.set()
        self._client.on_message = self._take
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        if not self._ready.wait(10):
            msg = "cannot subscribe"
            raise RuntimeError(msg)

    def _take(self, _client: Any, _data: Any, message: Any) -> None:
        self.got.append((time.monotonic(), json.loads(message.payload)))

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process, in megabytes."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) * 1024 / 1e6


def run(scene: str, model: str, duration_s: float, folder: Path) -> dict[str, Any]:
    """Measure one run of the daemon."""
    context = mp.get_context("spawn")
    times = context.Array("d", round((duration_s + 60) * RATE_HZ), lock=False)
    n_frames = context.Value("l", 0, lock=False)
    near, far = context.Pipe(duplex=False)
    module = context.Process(
        target=module_process, args=(scene, far, times, n_frames), daemon=True
    )
    module.start()
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    broker = start_broker(folder, port)
    subscriber = Subscriber(port)
    outputs = ("-o", f"mqtt://127.0.0.1:{port}", "-o", f"store:{folder / 'radard.db'}")
    path = near.recv()
    began_s = time.monotonic()
    daemon = subprocess.Popen(
        [sys.executable, "-m", "radard", "--port", path, "--model", model, *outputs],
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "RADARD_SERVICE__STATE_DIR": str(folder),
            "RADARD_SERVICE__RUNTIME_DIR": str(folder),
        },
        stderr=subprocess.DEVNULL,
    )
    try:
        while not subscriber.got and daemon.poll() is None and time.monotonic() - began_s < 30:
            time.sleep(0.01)
        first_s = subscriber.got[0][0] - began_s
        time.sleep(duration_s)
        memory_mb = resident_mb(daemon.pid)
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.wait(10)
        subscriber.close()
        for process in (module, broker):
            process.terminate()
    decisions = [item for item in subscriber.got if item[1]["dropped"] == 0]
    published = [at - times[round(d["t_s"] * RATE_HZ) - 1] for at, d in decisions]
    return {
        "published_s": published,
        "daemon_s": [d["latency_ms"] / 1e3 for _, d in decisions],
        "n_open": sum(d["gate"] == "open" for _, d in decisions),
        "resident_mb": memory_mb,
        "beyond_frames_s": first_s - DWELL_FRAMES / RATE_HZ,
    }


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="thesis_dog")
    parser.add_argument("--model", default="balanced")
    parser.add_argument("--duration", type=float, default=60.0, help="seconds a run")
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    runs = []
    for _ in range(args.runs):
        with tempfile.TemporaryDirectory() as name:
            runs.append(run(args.scene, args.model, args.duration, Path(name)))
    out: dict[str, Any] = {"runs": len(runs), "load_1min": os.getloadavg()[0]}
    for key in ("published_s", "daemon_s"):
        ms = 1e3 * np.concatenate([each[key] for each in runs])
        p50, p99 = np.percentile(ms, [50, 99])
        name = key.removesuffix("_s")
        out |= {f"{name}_p50_ms": p50, f"{name}_p99_ms": p99, f"{name}_max_ms": ms.max()}
    out["decisions"] = sum(len(each["published_s"]) for each in runs)
    out["gate_open"] = sum(each["n_open"] for each in runs)
    out["resident_mb"] = max(each["resident_mb"] for each in runs)
    out["beyond_frames_s"] = sorted(each["beyond_frames_s"] for each in runs)[len(runs) // 2]
    print(json.dumps({k: round(v, 3) for k, v in out.items()}))


if __name__ == "__main__":
    main()
