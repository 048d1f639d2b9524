"""Levers: what an installer can set, and what each setting costs in misses, alarms and time."""
