"""An MQTT broker in a process of its own: `python -m tests.mqtt_broker CONFIG`, which is JSON.

It writes a line once clients can connect, and ends when killed or with its standard input. amqtt's
own shutdown may wait for ever for a client that connects at that moment.
"""

import asyncio
import json
import sys

from amqtt.broker import Broker


class SteadySubscriptions(dict):
    """A broker's subscriptions, which it may change while it goes through them.

    amqtt 0.12 awaits inside such loops; a client that subscribes meanwhile would end them, and
    with them another client's connection or all delivery.
    """

    def __iter__(self):
        return iter(list(super().__iter__()))

    def items(self):
        return list(super().items())


async def serve(config):
    """Serve until nobody holds the standard input."""
    broker = Broker(config)
    broker._subscriptions = SteadySubscriptions()
    await broker.start()
    sys.stdout.write("serves\n")
    sys.stdout.flush()
    over = asyncio.Event()
    asyncio.get_running_loop().add_reader(sys.stdin.fileno(), over.set)
    await over.wait()


if __name__ == "__main__":
    asyncio.run(serve(json.loads(sys.argv[1])))
