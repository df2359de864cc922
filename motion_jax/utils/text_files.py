"""Text files as people's programs write them, read in one place: encodings, line ends, tables.

Excel writes tables with semicolons and in the computer's own encoding, editors write byte-order marks, other programs
UTF-16. What is read holds whole characters only; an error is an InputError that names the file and the line, or a
FileNotFoundError.

Why not charset-normalizer (3.5.3, measured 2026-11-28): it decides by how likely the letters are, for which captions
and names are too short. "café" and "x,y;Ä" in Windows-1252 come out as Chinese UTF-16, even with only these encodings
to choose from.
"""
import csv
import io
import pathlib
import re
import warnings
from typing import NamedTuple

from motion_jax.utils.errors import InputError, reading

LARGEST = 64 * 2**20   # bytes; the captions of the largest data sets are half of it
LARGEST_MOTION = 4 * LARGEST
_LONGEST_STEM = 240  # bytes; file systems take 255 with the ending
_MOST_ROWS = 1_000_000
_MARKS = ((b"\xff\xfe\x00\x00", "utf-32"), (b"\x00\x00\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"),
          (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
_LINE_ENDS = re.compile("\r\n|\n|\r")
_BREAKS = re.compile("[ \t]*[\r\n]+[ \t]*")
_DELIMITERS = (",", ";", "\t")
_CONTROL = re.compile("[\x00-\x08\x0e-\x19\x1b-\x1f]")  # \x1a ended files under DOS
_SURROGATE = re.compile("[\ud800-\udfff]")


def split_cells(lines) -> list[list[str]]:
  """The cells of the lines of a table of numbers, stripped, without quotation marks. They are separated by what the
  first line has: tabs, semicolons (then a comma in a number is its decimal point), commas or blanks."""
  first = lines[0] if lines else ""
  separator = next((mark for mark in ("\t", ";", ",") if mark in first), None)
  rows = [[cell.strip().strip("\"'").strip() for cell in line.split(separator)] for line in lines]
  if separator == ";":
    rows = [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows]
  return rows


_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")


class Row(NamedTuple):
  """A row of a table: the number of the line it begins on, and its cells, stripped."""
  line: int
  cells: list[str]


def read_text(path, what="text file", largest=LARGEST) -> str:
  """The text of a file in UTF-8, UTF-16 or UTF-32, with or without a byte-order mark, or else in Windows-1252.

  Windows-1252 is a guess, which a warning tells. Raises FileNotFoundError, or ValueError for a file that holds no text,
  halves of characters, or more than `largest` bytes.
  """
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no {what} {path}")
  size = path.stat().st_size
  if size > largest:
    raise InputError(f"{path} has {size / 2**20:,.0f} MiB, expected a {what} of at most {largest // 2**20}; cut it in "
                     "parts")
  with reading(path):
    data = path.read_bytes()
  text = _decoded(path, data)
  match = _CONTROL.search(text)
  if match:
    raise InputError(f"{path} line {_line(text[:match.start()])}: character {ord(match.group()):#04x} is no text; the "
                     f"file is damaged, or no {what}")
  return text.removesuffix("\x1a")


def _decoded(path, data):
  encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None) or _without_mark(data)
  try:
    return data.decode(encoding)
  except UnicodeDecodeError as error:
    wrong = error
  if encoding == "utf-8" and not _is_half(data[wrong.start:wrong.start + 3]):
    try:
      text = data.decode("cp1252")
      if not _CONTROL.search(text):
        warnings.warn(f"{path} is not UTF-8 (line {_line(data[:wrong.start])}), read as Windows-1252; save it as UTF-8 "
                      "if letters come out wrong", stacklevel=4)
        return text
    except UnicodeDecodeError:
      pass
  before = data[:wrong.start].decode(encoding, errors="replace")
  raise InputError(f"{path} line {_line(before)}: byte {data[wrong.start]:#04x} is no {encoding.upper()} text; save "
                   "the file as UTF-8") from None


def _without_mark(data):
  """The encoding of bytes without a mark: every other one is 0 in the UTF-16 of most languages."""
  sample = data[:4096]
  if len(data) % 2 == 0 and len(sample) > 1:
    zeros = [sample[place::2].count(0) / (len(sample) / 2) for place in (0, 1)]
    if zeros[1] > 0.4 and zeros[0] < 0.1:
      return "utf-16-le"
    if zeros[0] > 0.4 and zeros[1] < 0.1:
      return "utf-16-be"
  return "utf-8"


def _is_half(data):
  """Whether bytes are half of a surrogate pair, written as if it were a character."""
  return len(data) == 3 and data[0] == 0xED and 0xA0 <= data[1] <= 0xBF and 0x80 <= data[2] <= 0xBF


def _line(before):
  """The number of the line on which a text or bytes end."""
  if isinstance(before, bytes):
    before = before.decode("latin-1")
  return len(_LINE_ENDS.findall(before)) + 1


def lines_of(text) -> list[str]:
  """Lines, split at line ends of files only; `str.splitlines` also splits at characters that may stand in a caption."""
  lines = _LINE_ENDS.split(text)
  return lines if lines[-1] else lines[:-1]


def read_lines(path, what="text file", largest=LARGEST) -> list[str]:
  """The lines of `read_text`."""
  return lines_of(read_text(path, what, largest))


def read_table(path, fits=None, what="table") -> list[Row]:
  """The non-empty rows of a CSV or TSV file, whatever its delimiter: a comma, a semicolon or a tab.

  fits(rows): whether rows were split as expected; the first delimiter that fits is taken, else the one that gives every
  row as many cells. A first line "sep=;", as Excel writes it, decides. Cells in quotes may run over lines.
  """
  path = pathlib.Path(path)
  text, first = read_text(path, what), 1
  given = re.match("sep=(.)(\r\n|\n|\r|$)", text, re.IGNORECASE)
  if given:
    text, first = text[given.end():], 2
    return _parted(path, text, given.group(1), first)
  ways = ("\t", ",", ";") if path.suffix.lower() == ".tsv" else _DELIMITERS
  wrong, tables = None, []
  for delimiter in ways:
    try:
      tables.append(_parted(path, text, delimiter, first))
    except InputError as error:
      wrong = wrong or error
  if not tables:
    raise wrong
  even = [rows for rows in tables if len({len(row.cells) for row in rows}) == 1 and len(rows[0].cells) > 1]
  return next((rows for rows in tables if fits and fits(rows)), (even or tables)[0])


def _parted(path, text, delimiter, first):
  reader, rows, line = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True), [], first
  try:
    for cells in reader:
      cells = [_BREAKS.sub(" ", cell).strip() for cell in cells]
      while cells and not cells[-1]:
        cells.pop()
      if cells:
        rows.append(Row(line, cells))
        if len(rows) > _MOST_ROWS:
          raise InputError(f"{path} has more than {_MOST_ROWS:,} rows; cut it in parts")
      line = reader.line_num + first
  except csv.Error as error:
    raise InputError(f"{path} line {line}: {error}; a quote inside a quoted cell is written twice") from None
  return rows


def file_stem(name, where) -> str:
  """The name of a clip in a list, which is also that of its file. Raises InputError, begun by `where`, for a name that
  no file can have."""
  if not 0 < len(name.encode("utf-8", "replace")) <= _LONGEST_STEM or any(mark in name for mark in "/\\\0"):
    short = name if len(name) <= 40 else name[:39] + "…"
    raise InputError(f"{where}: got the name {short!r}, expected that of a file without its ending, of at most "
                     f"{_LONGEST_STEM} bytes and without / and \\")
  return name


def is_text(value) -> bool:
  """Whether the strings in a value (a str, or lists and dicts of such) can be written: none holds half a character, as
  of "\\ud800" in JSON or of bytes on a command line that are no UTF-8."""
  if isinstance(value, dict):
    return all(map(is_text, value)) and all(map(is_text, value.values()))
  if isinstance(value, list | tuple):
    return all(map(is_text, value))
  return not (isinstance(value, str) and _SURROGATE.search(value))


__all__ = ["LARGEST_MOTION", "Row", "file_stem", "is_text", "lines_of", "read_lines", "read_table", "read_text"]
