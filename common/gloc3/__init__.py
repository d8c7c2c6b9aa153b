"""GLOC3: a control software architecture for unmanned vehicles, built from one generic component."""

__version__ = "0.1.0"
