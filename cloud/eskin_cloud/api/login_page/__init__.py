"""The login page."""

from __future__ import annotations

import html
from importlib.resources import files
from string import Template


def login_page(message: str) -> bytes:
    """The page with its form.

    Args:
        message: What went wrong, or nothing.
    """
    template = Template((files(__package__) / "login.html").read_text(encoding="utf-8"))
    return template.substitute(message=html.escape(message)).encode()


def login_style() -> bytes:
    """The page's style sheet."""
    return (files(__package__) / "login.css").read_bytes()
