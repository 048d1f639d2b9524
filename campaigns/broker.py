"""What the MQTT broker of campaigns does beside its work: it notes every event that it takes."""

from dataclasses import dataclass
from pathlib import Path

from amqtt.broker import BrokerContext
from amqtt.plugins.base import BasePlugin
from amqtt.session import ApplicationMessage


class EventLog(BasePlugin[BrokerContext]):
    """Write the payload of every message on a topic that ends with /event, a line each."""

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
