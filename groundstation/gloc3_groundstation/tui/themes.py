"""The colours: few, and distinguishable by colour-blind operators (Okabe and Ito's palette); words say it too."""

from typing import Any, Final

from textual.app import App
from textual.theme import BUILTIN_THEMES, Theme

THEMES: Final = (
    Theme(
        name="dark",
        dark=True,
        background="#101418",
        surface="#101418",
        panel="#1c232a",
        foreground="#d4dae0",
        primary="#56b4e9",
        secondary="#909daa",
        accent="#56b4e9",
        success="#2fb98f",
        warning="#e8a33d",
        error="#f0724a",
        variables={
            "quiet": "#909daa",
            "rule": "#38424c",
            "cursor": "#24313d",
            "ground": "#6b5a3e",
            "first": "#56b4e9",
            "second": "#d68fc1",
            "third": "#e8dc5a",
            "fourth": "#2fb98f",
            "fifth": "#a9a6ff",
            "sixth": "#f0a58a",
        },
    ),
    Theme(
        name="daylight",
        dark=False,
        background="#ffffff",
        surface="#ffffff",
        panel="#e6e9ec",
        foreground="#000000",
        primary="#004f8a",
        secondary="#454d55",
        accent="#004f8a",
        success="#00582c",
        warning="#8a5400",
        error="#c00046",
        variables={
            "quiet": "#454d55",
            "rule": "#8c959d",
            "cursor": "#c9dff0",
            "ground": "#c2a878",
            "first": "#004f8a",
            "second": "#7d2f63",
            "third": "#5c5400",
            "fourth": "#00582c",
            "fifth": "#40349c",
            "sixth": "#a83200",
        },
    ),
    Theme(
        name="mono",
        ansi=True,
        background="ansi_default",
        surface="ansi_default",
        panel="ansi_default",
        boost="ansi_default",
        foreground="ansi_default",
        primary="ansi_default",
        secondary="ansi_default",
        accent="ansi_default",
        success="ansi_default",
        warning="ansi_default",
        error="ansi_default",
        variables={
            **dict.fromkeys(BUILTIN_THEMES["ansi-dark"].variables, "ansi_default"),
            **dict.fromkeys(("quiet", "rule", "cursor", "ground"), "ansi_default"),
            **dict.fromkeys(("first", "second", "third", "fourth", "fifth", "sixth"), "ansi_default"),
            **dict.fromkeys(("block-cursor-background", "border"), "ansi_default"),
            **dict.fromkeys(("block-cursor-text-style", "input-cursor-text-style"), "reverse"),
        },
    ),
)

DESCRIPTIONS: Final = {
    "dark": "few colours on near black",
    "daylight": "black on white, for sunlight",
    "mono": "no colours: bold, reverse and underlined",
}


def offer_themes(app: App[Any]) -> None:
    """Makes these the only themes of an app."""
    for theme in THEMES:
        app.register_theme(theme)
    for name in set(app.available_themes) - {theme.name for theme in THEMES}:
        app.unregister_theme(name)
