"""The colours: few, and apart for those who see red and green alike (Okabe and Ito's palette)."""

from textual.theme import Theme

THEME = Theme(
    name="gloc3",
    dark=True,
    background="#101418",
    surface="#101418",
    panel="#1c232a",
    foreground="#d4dae0",
    primary="#56b4e9",
    secondary="#7d8a97",
    accent="#56b4e9",
    success="#2fb98f",
    warning="#e8a33d",
    error="#f0724a",
)
