"""MQTT: `link` keeps the connection, `topics` decides what is published, `sink` joins them."""
