"""Points of a character written into its MJCF text, everything else left as it stands.

Comments, order and indentation survive: only the tags concerned are cut out or put in, at the
places where an XML parser found them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from physretarget.errors import InputError

__all__ = ["drop_point", "put_point"]

# Attributes that say where a site is; the others, its look among them, stay.
_PLACE = frozenset({"name", "pos", "fromto"})


@dataclass
class _Node:
    """An element: the bytes of its start tag, and of all of it."""

    tag: str
    attributes: dict[str, str]
    start: int
    parent: _Node | None
    opened: int = 0
    end: int = 0
    children: list[_Node] = field(default_factory=list)


def put_point(
    text: str, *, name: str, body: str, place: Sequence[float], tie: str | None = None
) -> str:
    """Write a site where it belongs, in place of one of the same name.

    Args:
        text: the MJCF.
        name: of the site, ``contact_...`` or ``marker_...``.
        body: the name of the body that it is fixed on.
        place: (3,) m in the body's frame.
        tie: the actor's point that it follows, None for none.

    Returns:
        The MJCF with the site.

    Raises:
        InputError: the body is not written in this text.
    """
    old, look = _find(text, "site", name), {"group": "3"}
    if old is not None:
        look = {k: v for k, v in old.attributes.items() if k not in _PLACE}
    where = " ".join(f"{value:.6g}" for value in place)
    made = _tag("site", {"name": name, "pos": where, **look})
    if old is not None and old.parent and old.parent.attributes.get("name") == body:
        text = _instead(text, old, made)
    else:
        if old is not None:
            text = _without(text, old)
        if (node := _find(text, "body", body)) is None:
            raise InputError(
                f"body {body!r} has no tag of its own there (it is included, attached, replicated "
                "or has no name): write the site into it by hand"
            )
        text = _inside(text, node, made)
    return _tied(text, name, tie)


def _tied(text: str, name: str, tie: str | None) -> str:
    old = _find(text, "text", name)
    if tie is None:
        return text if old is None else _without(text, old)
    made = _tag("text", {"name": name, "data": tie})
    if old is not None:
        return _instead(text, old, made)
    if (custom := _find(text, "custom")) is not None:
        return _inside(text, custom, made)
    root = _find(text, "mujoco")
    if root is None:
        raise InputError("it is no MJCF: <mujoco> is missing")
    return _inside(text, root, f"<custom>{made}</custom>")


def drop_point(text: str, name: str) -> str:
    """Take a site away, and what ties it to the actor.

    Args:
        text: the MJCF.
        name: of the site.

    Returns:
        The MJCF without it; the same text if there is none.
    """
    for tag in ("site", "text"):
        if (node := _find(text, tag, name)) is not None:
            text = _without(text, node)
    return text


def _tag(tag: str, attributes: Mapping[str, str]) -> str:
    return f"<{tag} {' '.join(f'{k}={quoteattr(v)}' for k, v in attributes.items())}/>"


def _find(text: str, tag: str, name: str | None = None) -> _Node | None:
    """The first element of a tag, and of a name where one is given."""
    waiting = [_tree(text)]
    while waiting:
        node = waiting.pop(0)
        if node.tag == tag and (name is None or node.attributes.get("name") == name):
            return node
        waiting += node.children
    return None


def _tree(text: str) -> _Node:
    content = text.encode()
    parser = expat.ParserCreate("utf-8")
    open_nodes: list[_Node] = []
    roots: list[_Node] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        parent = open_nodes[-1] if open_nodes else None
        node = _Node(tag, attributes, parser.CurrentByteIndex, parent)
        node.opened = _tag_end(content, node.start)
        (parent.children if parent else roots).append(node)
        open_nodes.append(node)

    def end(_: str) -> None:
        node = open_nodes.pop()
        empty = content[node.opened - 2 : node.opened] == b"/>"
        node.end = node.opened if empty else _tag_end(content, parser.CurrentByteIndex)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(
            f"broken XML: {expat.ErrorString(error.code)}", line=error.lineno
        ) from error
    return roots[0]


def _tag_end(content: bytes, start: int) -> int:
    """Behind the ``>`` that ends the tag, which quotes may hold too."""
    found = re.compile(rb"""<(?:[^>"']|"[^"]*"|'[^']*')*>""").match(content, start)
    assert found, "the parser has read a tag here"
    return found.end()


def _indent(content: bytes, at: int) -> bytes:
    """The white space that the line of a place begins with."""
    line = content[content.rfind(b"\n", 0, at) + 1 : at]
    return line[: len(line) - len(line.lstrip())]


def _inside(text: str, node: _Node, made: str) -> str:
    content = text.encode()
    inner = b"\n" + _indent(content, node.start) + b"  " + made.encode()
    head, tail = content[: node.opened], content[node.opened :]
    if head.endswith(b"/>"):
        close = b"\n" + _indent(content, node.start) + f"</{node.tag}>".encode()
        return (head[:-2].rstrip() + b">" + inner + close + tail).decode()
    return (head + inner + tail).decode()


def _instead(text: str, node: _Node, made: str) -> str:
    content = text.encode()
    return (content[: node.start] + made.encode() + content[node.end :]).decode()


def _without(text: str, node: _Node) -> str:
    """Without an element, nor the line that it alone stood on."""
    content = text.encode()
    head, tail = content[: node.start], content[node.end :]
    bare = head.rstrip(b" \t")
    if bare.endswith(b"\n") and tail.lstrip(b" \t\r").startswith(b"\n"):
        head, tail = bare[:-1].removesuffix(b"\r"), tail.lstrip(b" \t")
    return (head + tail).decode()
