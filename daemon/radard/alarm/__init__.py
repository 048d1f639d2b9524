"""From decisions to alarms: zones, sensitivity, the panel, tampering, events with an id."""
