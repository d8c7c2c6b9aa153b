"""The onboard process: what it holds open besides links and components: logs, records, storage, the computer itself.

`gloc3_onboard.assembly` wires it.
"""
