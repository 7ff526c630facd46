"""The headline figures at the top of a report, which are also printed on the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from softprint.fem_truth.report.drawing.style import ModelStyle
from softprint.fem_truth.report.page import format_number, look_up


@dataclass(frozen=True)
class Card:
    """One headline figure: its value, its style (see `page.format_number`), its label and a note."""

    value: float
    style: str
    label: str
    note: str


def headline_cards(
    summary: Mapping[str, Any], model: str | None, styles: Mapping[str, ModelStyle]
) -> list[Card]:
    """Cards for accuracy, contact displacement and speed of `model`, as far as they were measured."""
    if model is None:
        return []
    cards = [_accuracy(summary, model, styles), _displacement(summary, model, styles)]
    return [card for card in [*cards, *_speed(summary, model)] if card is not None]


def _accuracy(summary: Mapping[str, Any], model: str, styles: Mapping[str, ModelStyle]) -> Card | None:
    row = look_up(summary, f"errors/{model}")
    if row is None:
        return None
    others = [
        f"{styles[name].label}: {_percent(look_up(summary, f'errors/{name}/relative_rms'))}."
        for name in summary["errors"]
        if name not in ("full", "bare", model)
    ]
    perfect = look_up(summary, "errors_solved/truth/relative_rms")
    if perfect is not None:
        others.append(
            f"With the exact contact displacement, without internal deformation: {_percent(perfect)}."
        )
    return Card(
        row["relative_rms"],
        "percent",
        "of the bare subspace\u2019s error remains",
        " ".join(
            [
                f"{row['n_frames']} frames {'in contact ' if summary.get('collider') else ''}of unseen motions; "
                f"squared {_percent(row['relative_rms_squared'])}.",
                *others,
            ]
        ),
    )


def _displacement(summary: Mapping[str, Any], model: str, styles: Mapping[str, ModelStyle]) -> Card | None:
    value = look_up(summary, f"contact_displacement/{model}")
    if value is None:
        return None
    notes = ["Relative to the exact contact displacement of the same states."]
    for name in ("linear_response", "thesis5"):
        other = look_up(summary, f"contact_displacement/{name}")
        if other is not None and name != model:
            notes.append(f"{styles[name].label}: {_percent(other)}.")
    floor = look_up(summary, "truth/noise_floor")
    if floor is not None:
        tail = look_up(summary, "truth/noise_90")
        notes.append(f"Label-noise floor: {_percent(floor)}, 90th percentile {_percent(tail)}.")
    return Card(value, "percent", "error of the contact displacement itself", " ".join(notes))


def _speed(summary: Mapping[str, Any], model: str) -> list[Card]:
    row = look_up(summary, f"timings/{model}")
    if row is None:
        return []
    cost = (
        f" {format_number(row['cost_of_bare'], 'times')} the cost of the bare subspace."
        if row["cost_of_bare"]
        else ""
    )
    cards = [
        Card(
            row["steps_per_second"],
            "plain",
            "steps per second in contact" if summary.get("collider") else "steps per second",
            f"{format_number(row['step'], 'ms')} per step without the surface, {row['iterations']:.1f} Newton "
            f"iterations, {_percent(row['converged'])} of the steps converged; "
            f"{summary['machine']['cores']} cores.{cost}",
        )
    ]
    if row["faster_than_full"]:
        full = format_number(summary["timings"]["full"]["step"], "ms")
        cards.append(
            Card(
                row["faster_than_full"],
                "times",
                "faster than our own full-space step",
                f"Same step size, same cores; the full-space step takes {full}.",
            )
        )
    return cards


def console_lines(summary: Mapping[str, Any], cards: list[Card]) -> list[str]:
    """The headline for a terminal."""
    width = max((len(format_number(card.value, card.style)) for card in cards), default=0)
    lines = [f"{summary['experiment']['name']}: held-out motion"]
    for card in cards:
        lines.append(f"  {format_number(card.value, card.style):>{width}}  {card.label}")
        lines.append(f"  {'':>{width}}  {card.note}")
    return [line.replace("\u202f", " ").replace("\u2019", "'") for line in lines]


def _percent(value: Any) -> str:
    return format_number(value, "percent") if value is not None else "\u2013"
