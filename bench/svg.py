"""A scatter chart with a logarithmic x axis as SVG text, without any library."""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 460, 340
LEFT, RIGHT, TOP, BOTTOM = 58, 16, 34, 46  # margins of the plot
COLORS = {"lull": "#c2410c", "oidn": "#1d4ed8", "classic": "#4d7c0f", "input": "#57534e"}


@dataclass(frozen=True)
class Point:
    label: str
    kind: str  # a key of COLORS
    x: float  # > 0
    y: float


def _ticks(low: float, high: float) -> list[float]:
    """Four to nine round values inside [low, high]."""
    step = 10 ** math.floor(math.log10((high - low) / 4))
    step *= next(f for f in (1, 2, 2.5, 5, 10) if (high - low) / (step * f) <= 9)
    return [i * step for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def panel(points: list[Point], title: str, y_title: str, x_title: str, at: int,
          down: int = 0) -> str:
    """One chart, moved right by `at` and down by `down` pixels."""
    low_x = 10 ** math.floor(math.log10(min(p.x for p in points)))
    high_x = 10 ** math.ceil(math.log10(max(p.x for p in points) * 1.05))
    ys = [p.y for p in points]
    pad = (max(ys) - min(ys) or 1) * 0.1
    low_y, high_y = min(ys) - pad, max(ys) + pad
    span_x, span_y = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def px(x: float) -> float:
        return LEFT + span_x * math.log(x / low_x) / math.log(high_x / low_x)

    def py(y: float) -> float:
        return TOP + span_y * (high_y - y) / (high_y - low_y)

    out = [f'<g transform="translate({at},{down})">',
           f'<rect x="{LEFT}" y="{TOP}" width="{span_x}" height="{span_y}" fill="#fff" '
           'stroke="#a8a29e"/>',
           f'<text x="{LEFT}" y="20" font-weight="bold">{escape(title)}</text>',
           f'<text x="{LEFT + span_x / 2}" y="{HEIGHT - 10}" text-anchor="middle">'
           f'{escape(x_title)}</text>',
           f'<text transform="translate(14,{TOP + span_y / 2}) rotate(-90)" '
           f'text-anchor="middle">{escape(y_title)}</text>']
    decade = low_x
    while decade <= high_x * 1.001:
        x = px(decade)
        out += [f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{TOP + span_y}" '
                'stroke="#e7e5e4"/>',
                f'<text x="{x:.1f}" y="{TOP + span_y + 15}" text-anchor="middle">{decade:g}</text>']
        decade *= 10
    for value in _ticks(low_y, high_y):
        y = py(value)
        out += [f'<line x1="{LEFT}" x2="{LEFT + span_x}" y1="{y:.1f}" y2="{y:.1f}" '
                'stroke="#e7e5e4"/>',
                f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{value:.4g}</text>']
    taken: list[tuple[float, float]] = []
    for p in sorted(points, key=lambda p: p.y):
        x, y = px(p.x), py(p.y)
        right = x < LEFT + span_x * 0.6
        text_y = y + 4
        while any(abs(text_y - other) < 11 and abs(x - at_x) < 130 for at_x, other in taken):
            text_y -= 11
        taken.append((x, text_y))
        color = COLORS[p.kind]
        out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{color}"/>',
                f'<text x="{x + (7 if right else -7):.1f}" y="{text_y:.1f}" fill="{color}" '
                f'text-anchor="{"start" if right else "end"}">{escape(p.label)}</text>']
    return "\n".join([*out, "</g>"])


def chart(rows: list[list[tuple[str, str, list[Point]]]], x_title: str) -> str:
    """Rows of charts side by side; each: (title, y title, points)."""
    body = [panel(points, title, y_title, x_title, i * WIDTH, j * HEIGHT)
            for j, row in enumerate(rows) for i, (title, y_title, points) in enumerate(row)]
    width, height = WIDTH * max(map(len, rows)), HEIGHT * len(rows)
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>', *body, "</svg>", ""])
