"""Reads the pages that Softprint writes."""

from __future__ import annotations

from html.parser import HTMLParser


class Reader(HTMLParser):
    """Collects the numbers of a page and all resources that it would load."""

    def __init__(self):
        super().__init__()
        self.numbers, self.loads, self.tags, self.missing_alt = [], [], set(), 0

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.add(tag)
        if tag == "data":
            self.numbers.append((found["data-key"], found["value"]))
        if tag == "img" and not found.get("alt"):
            self.missing_alt += 1
        self.loads += [
            found[name] for name in ("src", "href", "srcset", "xlink:href", "action") if name in found
        ]
