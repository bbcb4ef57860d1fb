"""The part of YAML that calibration tools write, read without a YAML library.

Mappings, sequences and scalars in block and flow style, quotes, comments and tags (which are
skipped); of several documents the first. Anchors, aliases and block text are refused by name.

Source: YAML specification 1.2.2, chapters 6 to 8.
"""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

__all__ = ["load_yaml"]

QUOTED = r"\"(?:[^\"\\]|\\.)*\"|'(?:[^']|'')*'"
QUOTED_WORD = re.compile(rf"(?<![^\s\[\]{{}},:])(?:{QUOTED})")
COMMENT = re.compile(rf"({QUOTED_WORD.pattern})|(?:^|(?<=\s))#.*")
KEY = re.compile(rf"(?P<key>[\w./+-]+|{QUOTED})\s*:(?:\s+(?P<rest>.*))?$")
TAG = re.compile(r"^!\S*\s*")
FLOW_TOKEN = re.compile(rf"\s*({QUOTED}|[\[\]{{}},]|:(?=\s|$)|(?:(?!:\s)[^\[\]{{}},])+)")
UNSUPPORTED = {"&": "an anchor", "*": "an alias", "|": "block text", ">": "block text"}
WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}
NUMBER = re.compile(r"[-+]?(\.\d+|\d+(\.\d*)?)([eE][-+]?\d+)?")
SPECIAL_NUMBER = re.compile(r"[-+]?\.(inf|nan)", re.IGNORECASE)


@dataclass(frozen=True)
class _Line:
    """A line without its comment, or several that a bracket holds together.

    Attributes:
        number: of the first of them in the file, from 1.
        indent: blanks before it.
        text: what follows them.
    """

    number: int
    indent: int
    text: str

    @property
    def is_item(self) -> bool:
        return self.text == "-" or self.text.startswith("- ")


def load_yaml(text: str) -> Any:  # noqa: ANN401  whatever the file holds
    """Return what a YAML file holds: dictionaries, lists, numbers, words, None.

    Args:
        text: of the file.

    Raises:
        ValueError: with the number of the line, if it is no YAML or beyond the part known here.
    """
    lines = _joined(_lines(text))
    return _value(lines) if lines else None


def _lines(text: str) -> list[_Line]:
    """Return the lines of the first document that say something."""
    lines: list[_Line] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        if raw.startswith(("---", "...")):
            if lines:
                break
            continue
        stripped = COMMENT.sub(r"\1", raw).rstrip()
        content = stripped.lstrip()
        if not content or raw.startswith("%"):
            continue
        blanks = stripped[: -len(content)]
        if "\t" in blanks:
            raise ValueError(f"line {number} is indented with a tab; YAML demands blanks")
        lines.append(_Line(number, len(blanks), content))
    return lines


def _joined(lines: list[_Line]) -> list[_Line]:
    """Return the lines with those within a bracket made one."""
    joined: list[_Line] = []
    depth = 0
    for line in lines:
        if depth > 0:
            first = joined.pop()
            line = _Line(first.number, first.indent, f"{first.text} {line.text}")
        joined.append(line)
        depth = _depth(line.text)
    if depth > 0:
        raise ValueError(
            f"line {joined[-1].number} opens a bracket that is never closed; is the file cut off?"
        )
    return joined


def _depth(text: str) -> int:
    """Return how many brackets are open at the end."""
    bare = QUOTED_WORD.sub("", text)
    return sum(bare.count(opening) for opening in "[{") - sum(bare.count(end) for end in "]}")


def _value(lines: list[_Line]) -> Any:  # noqa: ANN401
    """Return what a block of lines holds; its first line is indented the least."""
    head = lines[0]
    if head.is_item:
        return [_item(group) for group in _groups(lines)]
    if KEY.match(head.text):
        return _mapping(_groups(lines))
    if len(lines) > 1:
        raise ValueError(
            f"line {lines[1].number}: expected 'key: value' above, got {head.text[:40]!r}"
        )
    return _inline(head.text, head.number)


def _groups(lines: list[_Line]) -> list[list[_Line]]:
    """Return each entry of a block with the lines that belong to it."""
    head = lines[0]
    starts = []
    for index, line in enumerate(lines):
        if line.indent < head.indent:
            raise ValueError(
                f"line {line.number} is indented by {line.indent} blanks, which fits none above; "
                "was the file edited by hand?"
            )
        # A list may stand right below its key, as far left.
        if line.indent == head.indent and (head.is_item or not line.is_item):
            starts.append(index)
    return [lines[start:end] for start, end in pairwise([*starts, len(lines)])]


def _item(group: list[_Line]) -> Any:  # noqa: ANN401
    """Return an entry of a list."""
    head, *children = group
    content = head.text[1:].lstrip()
    if not head.is_item:
        raise ValueError(f"line {head.number}: expected '- value', got {head.text[:40]!r}")
    if content:
        indent = head.indent + len(head.text) - len(content)
        children = [_Line(head.number, indent, content), *children]
    return _value(children) if children else None


def _mapping(groups: list[list[_Line]]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for head, *children in groups:
        match = KEY.match(head.text)
        if match is None:
            raise ValueError(f"line {head.number}: expected 'key: value', got {head.text[:40]!r}")
        key = str(_scalar(match["key"])) if match["key"][0] in "\"'" else match["key"]
        if key in entries:
            raise ValueError(f"line {head.number}: {key} is there twice")
        inline = TAG.sub("", match["rest"] or "")
        if inline and children:
            raise ValueError(f"line {children[0].number} is indented, but {key} has a value above")
        entries[key] = _value(children) if children else _inline(inline, head.number)
    return entries


def _inline(text: str, number: int) -> Any:  # noqa: ANN401
    """Return the value of a piece of one line."""
    text = TAG.sub("", text)
    if text[:1] in UNSUPPORTED:
        raise ValueError(
            f"line {number} holds {UNSUPPORTED[text[0]]} ({text[:20]!r}), which this program does "
            "not read; write the value itself"
        )
    if not text.startswith(("[", "{")):
        return _scalar(text)
    tokens = deque(token.strip() for token in FLOW_TOKEN.findall(text))
    value = _flow(tokens, number)
    if tokens:
        raise ValueError(f"line {number}: {tokens[0]!r} stands behind the closing bracket")
    return value


def _flow(tokens: deque[str], number: int) -> Any:  # noqa: ANN401
    """Return the value that begins with the first token, and take its tokens away."""
    token = tokens.popleft() if tokens else "the end"
    if token == "[":
        return _listed(tokens, "]", number, lambda: _flow(tokens, number))
    if token == "{":
        return dict(_listed(tokens, "}", number, lambda: _flow_entry(tokens, number)))
    if token in "]},:":
        raise ValueError(f"line {number}: expected a value, got {token!r}")
    return _scalar(token)


def _flow_entry(tokens: deque[str], number: int) -> tuple[str, Any]:
    key = str(_flow(tokens, number))
    _take(tokens, ":", number)
    return key, _flow(tokens, number)


def _listed(tokens: deque[str], closing: str, number: int, read: Callable[[], Any]) -> list[Any]:
    """Return what is read between commas, up to the closing bracket."""
    items = []
    while tokens and tokens[0] != closing:
        items.append(read())
        if tokens and tokens[0] != closing:
            _take(tokens, ",", number)
    _take(tokens, closing, number)
    return items


def _take(tokens: deque[str], wanted: str, number: int) -> None:
    token = tokens.popleft() if tokens else "the end"
    if token != wanted:
        raise ValueError(f"line {number}: expected {wanted!r}, got {token!r}")


def _scalar(text: str) -> Any:  # noqa: ANN401
    if text[:1] == "'":
        return text[1:-1].replace("''", "'")
    if text[:1] == '"':
        return _unescaped(text)
    if text.lower() in WORDS:
        return WORDS[text.lower()]
    if SPECIAL_NUMBER.fullmatch(text):
        return float(text.replace(".", ""))
    if NUMBER.fullmatch(text):
        return int(text) if re.fullmatch(r"[-+]?\d+", text) else float(text)
    return text


def _unescaped(text: str) -> str:
    try:
        return str(json.loads(text))
    except json.JSONDecodeError:
        return text[1:-1]
