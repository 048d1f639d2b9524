"""An MQTT broker in a process of its own, which notes every event that it takes.

    python campaigns/broker.py PORT FILE

FILE gets the payload of every message on a topic that ends with /event, a line each.
"""

import asyncio
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from amqtt.broker import Broker, BrokerContext
from amqtt.plugins.base import BasePlugin
from amqtt.session import ApplicationMessage


class EventLog(BasePlugin[BrokerContext]):
    """Note events."""

    async def on_broker_message_received(
        self, *, client_id: str, message: ApplicationMessage
    ) -> None:
        """Write the payload of an event."""
        del client_id
        if message.topic.endswith("/event") and message.data:
            with Path(self.config.path).open("ab") as file:
                file.write(bytes(message.data) + b"\n")

    @dataclass
    class Config:
        """Where to."""

        path: str = ""


async def serve(port: int, path: str) -> None:
    """Serve until the process ends."""
    plugins = {
        "amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True},
        "campaigns.broker.EventLog": {"path": path},
    }
    listeners = {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}"}}
    await Broker({"listeners": listeners, "plugins": plugins}).start()
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(serve(int(sys.argv[1]), sys.argv[2]))
