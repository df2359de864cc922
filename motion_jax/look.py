"""Colours and fonts of charts, drawings, reports and the documentation site, in light and dark.

A page names them as variables: `var(--ink)`, `var(--s0)`. `page_style()` is the style sheet of reports.
"""
import pathlib

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
MONO = "ui-monospace, SFMono-Regular, Menlo, Consolas, monospace"
# s0 to s4: lines of a chart, links (s0), marks (s1), what is good (s2). real: real motions. bad: failures.
LIGHT = {"page": "#f5f6f9", "card": "#ffffff", "ink": "#22262f", "soft": "#667085", "line": "#e1e5ec",
         "tint": "#f0f4fa", "s0": "#2a6fb8", "s1": "#d9622b", "s2": "#1c8552", "s3": "#8a4fb5", "s4": "#b0892b",
         "real": "#7d8594", "bad": "#c23a3a"}
DARK = {"page": "#14171c", "card": "#1c2027", "ink": "#e6e9ef", "soft": "#98a2b3", "line": "#303641",
        "tint": "#222834", "s0": "#74aeea", "s1": "#f0905f", "s2": "#5cc28e", "s3": "#c194e6", "s4": "#ddb95f",
        "real": "#99a1b0", "bad": "#f07c7c"}


def variables(colors: dict[str, str], prefix: str = "--") -> str:
  """CSS declarations of colours: "--ink: #22262f; ..."."""
  return " ".join(f"{prefix}{name}: {color};" for name, color in colors.items())


def page_style() -> str:
  """The style sheet of a report: colours that follow the reader's light or dark mode, text, tables, tiles, charts."""
  rules = (pathlib.Path(__file__).parent / "assets" / "report.css").read_text(encoding="utf-8")
  return "\n".join([f":root {{ color-scheme: light dark; --font: {FONT}; --mono: {MONO};", f"  {variables(LIGHT)} }}",
                    f"@media (prefers-color-scheme: dark) {{ :root {{ {variables(DARK)} }} }}", rules])
