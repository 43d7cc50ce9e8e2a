"""Colours of a light page and of a dark one, and styles of the pieces of HTML in their panels."""

from dataclasses import dataclass
from html import escape

from simaps_viz.colors.palette import Color


@dataclass(frozen=True)
class Theme:
    """Colours that differ between a light page and a dark one."""

    name: str
    dark: bool
    unseen: Color
    floor: Color
    clutter: Color
    """Ground on which something stands that has no name."""
    wall: Color
    ink: Color
    """Scale bar and compass."""
    selected: Color
    """The line around what is selected."""
    page: Color
    """viser's background behind the map."""
    panel: Color
    """viser's background behind the widgets."""
    text: Color
    """Text of our own HTML on ``panel``."""
    dim: Color
    """Text that matters less."""
    link: Color
    """Text that can be pressed."""

    @property
    def grounds(self) -> tuple[Color, Color, Color, Color]:
        """The colours of the kinds of ground, in the order of `colors.classes`."""
        return self.unseen, self.floor, self.clutter, self.wall


LIGHT = Theme(
    name="light",
    dark=False,
    unseen=(250, 250, 252),
    floor=(229, 233, 239),
    clutter=(190, 196, 206),
    wall=(92, 98, 110),
    ink=(38, 44, 56),
    selected=(15, 18, 26),
    page=(255, 255, 255),
    panel=(255, 255, 255),
    text=(26, 27, 30),
    dim=(73, 80, 87),
    link=(18, 89, 189),
)
DARK = Theme(
    name="dark",
    dark=True,
    unseen=(24, 25, 28),
    floor=(50, 54, 62),
    clutter=(84, 90, 102),
    wall=(158, 165, 178),
    ink=(214, 218, 226),
    selected=(255, 255, 255),
    page=(20, 20, 20),
    panel=(36, 36, 36),
    text=(222, 224, 228),
    dim=(184, 188, 194),
    link=(125, 180, 255),
)

BRAND: Color = (22, 110, 235)


def css(color: Color) -> str:
    """Write a colour for a style sheet: "#16181d"."""
    return "#{:02x}{:02x}{:02x}".format(*color)


TEXT_STYLE = f"color:light-dark({css(LIGHT.text)},{css(DARK.text)})"
"""Inline style of plain text; follows the page by itself."""
DIM_STYLE = f"color:light-dark({css(LIGHT.dim)},{css(DARK.dim)})"
"""Inline style of text that matters less, still with a contrast of 4.5 and more."""
BAD_STYLE = "color:light-dark(#b02a2a,#ff8f8f)"
"""Inline style of words about what went wrong."""
PAPER_STYLE = "background:light-dark(#f3f4f6,#2f3238);color:light-dark(#26282c,#dee0e4)"
"""Inline style of a sheet that lies on ``panel``: messages, programs."""
GOOD_PAPER_STYLE = "background:light-dark(#e7f6ec,#15301f);color:light-dark(#0b5d2a,#a6e3b8)"
BAD_PAPER_STYLE = "background:light-dark(#fdecec,#3a1b1b);color:light-dark(#8a1c1c,#ffb8b8)"
SENT_PAPER_STYLE = "background:light-dark(#eaf2fd,#1c2b40);color:light-dark(#26282c,#dee0e4)"
NESTED_EM = 0.96
"""Size of letters that matter less inside a block of text; smaller than this they are under 12 pixels."""
BADGE_STYLE = "background:#fff3cd;color:#6b4f00;border-radius:3px;padding:0 .4em;font-weight:600"
"""Inline style of a word that warns, such as "simulated"; the same on both pages."""
BOX_STYLE = "padding:.3em .8em .4em;font-size:.85em;line-height:1.5"
"""Inline style of a block of text in a panel."""
SMALL_STYLE = "padding:.1em .8em .45em;font-size:.82em;line-height:1.45"
"""Inline style of a block of smaller text, where there is much of it."""

STICKY = "simaps-sticky"
"""Class of a block of HTML that stays at the top of its panel while that scrolls; `page.css` has its style."""
MAX_NAME_LENGTH = 40
"""Characters of a name in a heading, a list or a legend; sequences may have classes of any length."""


def short(text: str, most: int = MAX_NAME_LENGTH) -> str:
    """Leave the middle out of a name that is too long."""
    if len(text) <= most:
        return text
    tail = most // 4
    return f"{text[: most - tail - 1].rstrip()}…{text[-tail:].lstrip()}"


def short_html(text: str) -> str:
    """Escape a name; one that is too long is shortened, and shown in full when the pointer rests on it."""
    cut = short(text)
    return escape(text) if cut == text else f'<span title="{escape(text)}">{escape(cut)}</span>'


def note_html(text: str) -> str:
    """Wrap a sentence (already escaped) as a quiet note."""
    return f'<div style="{BOX_STYLE};{DIM_STYLE}">{text}</div>'


def small_html(text: str) -> str:
    """Set a sentence in small."""
    return f'<div style="{SMALL_STYLE}">{escape(text)}</div>'


def remark_html(text: str) -> str:
    """Set a remark in small; none when the text is empty."""
    return f'<div style="{SMALL_STYLE};opacity:.75">{escape(text)}</div>' if text else ""


def working_html(text: str) -> str:
    """Return the line that is shown while something is being worked on."""
    return f'<div style="{SMALL_STYLE};opacity:.75" role="status"><i>{escape(text)} …</i></div>'
