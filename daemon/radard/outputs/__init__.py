"""Outputs: where records go, as -o/--output says (`radard.outputs.fanout`).

Every sink has a bounded queue and a thread; `radard.outputs.base` has the contract,
`radard.config.sink_table` the table. Nothing here knows of radar: sinks take mappings.
"""
