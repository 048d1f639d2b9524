"""Outputs: where records go, as -o/--output says (`radard.outputs.fanout`).

Every sink has a bounded queue and a thread of its own, so that a slow or broken one delays
neither the stream nor the other sinks; `radard.outputs.base` has the contract. Events are in the
log (`radard.log`) before any sink is told of them, and wait there until they are delivered.
Nothing here knows of radar: sinks take mappings, and import nothing of the pipeline. The table of
all sinks is `radard.config.sink_table`.
"""
