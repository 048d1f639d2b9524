"""MQTT: a sensor's topics, its commands, and what Home Assistant is told of it.

`sink` joins the others: `topics` decides what is published, `commands` reads what comes in,
`homeassistant` describes the entities, `link` keeps the connection.
"""
