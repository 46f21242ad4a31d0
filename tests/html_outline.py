"""An outline of an HTML page for tests: tags, ids, links and labels."""

from html.parser import HTMLParser

VOID = {"meta", "link", "br", "hr", "img", "input"}
HOSTILE = "<script>alert('x')</script>"


class Outline(HTMLParser):
    """Tags, ids, links and roles of a page; an unclosed tag is an error."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.ids, self.links, self.labels, self.open = [], [], [], [], []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        given = dict(attrs)
        self.tags.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[key] for key in ("href", "src", "action", "data", "srcset", "xlink:href") if key in given]
        self.labels += [given.get("aria-label", "")] if given.get("role") == "img" else []
        assert not [key for key in given if key.startswith("on")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
