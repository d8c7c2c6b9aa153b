"""The generic component (paper §IV) and its host: state machine, cycles, ports, settings, functions, supervision.

An author derives from `component` and declares `ports` and `settings`; `deployment` rows bring it up under a `host`.
"""

__all__ = [
    "action",
    "component",
    "context",
    "cycle",
    "deployment",
    "description",
    "error_handler",
    "functions",
    "host",
    "hosted",
    "lci",
    "memory",
    "ports",
    "settings",
    "supervision",
    "workers",
]
