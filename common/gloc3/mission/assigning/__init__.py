"""Chooses platforms for the tasks that several may perform: by capability, place and budget.

`assignment` judges what each vehicle can do with the checker and its estimate; `search` is the choice itself.
"""

__all__ = ["assignment"]
