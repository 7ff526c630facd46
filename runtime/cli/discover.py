"""Find the verbs: every entry point of the group `softprint.verbs` of any installed package."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec

from softprint.runtime.cli.verb import Verb

GROUP = "softprint.verbs"


@dataclass(frozen=True)
class FoundVerb:
    """A verb, or the reason why it is not available."""

    name: str
    verb: Verb | None
    unavailable: str = ""

    @property
    def order(self) -> tuple[float, str]:
        return (self.verb.order if self.verb else float("inf"), self.name)


def find_verbs() -> list[FoundVerb]:
    """All verbs in the order of the workflow; those whose module is not installed come last, with the reason."""
    found = {point.name: _load(point) for point in entry_points(group=GROUP)}
    return sorted(found.values(), key=lambda verb: verb.order)


def _load(point: EntryPoint) -> FoundVerb:
    package = point.module.partition(".")[0]
    if find_spec(package) is None or not _exists(point.module):
        return FoundVerb(point.name, None, f"{point.module} is not installed")
    verb = point.load()
    missing = verb.missing()
    return FoundVerb(point.name, verb, f"needs {' and '.join(missing)}" if missing else "")


def _exists(module: str) -> bool:
    """Whether a module can be found; this imports its parent packages, as always in Python."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False
