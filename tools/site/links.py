"""Links of the built site: files and headings that a link names and that are not there."""
import html
import pathlib
import re
import urllib.parse

PAGE = re.compile(r"<(script|style)\b.*?</\1>|<!--.*?-->", re.DOTALL)
TARGET = re.compile(r'<(?:a|img|link|script|iframe|source|form)\b[^>]*?\s(?:href|src|data-src|action)="([^"]*)"')
ANCHOR = re.compile(r'\s(?:id|name)="([^"]*)"')
MENTION = re.compile(r"(?<![\w/.-])docs/((?:[\w-]+/)*[\w-]+)\.md(#[\w-]+)?")  # as comments and docstrings name a page


def mentions(content, url, there):
  """HTML in which a page's name, such as docs/papers/cmdm.md#masks, is a link. url: that of the page it stands on.

  there(name): whether the site has a page "papers/cmdm.md". Code blocks and links stay as they are.
  """
  up = "../" * url.strip("/").count("/") + ("../" if url.strip("/") else "")

  def linked(mention):
    name, heading = mention[1], mention[2] or ""
    folder = {"README": ""}.get(name.rpartition("/")[2], name.rpartition("/")[2] + "/")
    place = "manual/" if name == "README" else f"{name.rpartition('/')[0]}/{folder}".lstrip("/")
    return f'<a href="{up}{place}{heading}">{mention[0]}</a>' if there(f"{name}.md") else mention[0]

  pieces = re.split(r"(?s)(<(pre|a|code|h\d)\b.*?</\2>|<[^>]*>)", content)
  return "".join(piece if i % 3 else MENTION.sub(linked, piece) for i, piece in enumerate(pieces) if i % 3 != 2)


def dead(site):
  """Sorted "page: link" of the links within a built site that lead nowhere."""
  site = pathlib.Path(site)
  texts = {path: PAGE.sub("", path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
  anchors = {path: {html.unescape(name) for name in ANCHOR.findall(text)} for path, text in texts.items()}
  dead_links = set()
  for path, text in texts.items():
    if path.name == "404.html":  # its links begin at the host
      continue
    for link in set(TARGET.findall(text)):
      parts = urllib.parse.urlsplit(html.unescape(link))
      if parts.scheme or parts.netloc or parts.path.startswith("/"):
        continue
      target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
      target = target / "index.html" if target.is_dir() else target
      heading = urllib.parse.unquote(parts.fragment)
      if not target.is_file() or heading and target in anchors and heading not in anchors[target]:
        dead_links.add(f"{path.relative_to(site)}: {link}")
  return sorted(dead_links)
