"""The mechanics of the body of a run directory: read from file, or computed and saved there."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody
    from softprint.runtime.mechanics.body_mechanics import BodyMechanics
    from softprint.runtime.mechanics.mechanics_file import MechanicsHeader

log = logging.getLogger(__name__)


class RunMechanics:
    """The mechanics files of a run directory, one for each requested number of contact nodes."""

    def __init__(self, context: Context, body: ReducedBody) -> None:
        self._context, self._body = context, body
        self._known: dict[int, tuple[MechanicsHeader, BodyMechanics]] = {}

    def path(self, contact_nodes: int) -> Path:
        """The path of the file."""
        from softprint.runtime.mechanics.mechanics_file import mechanics_path

        return mechanics_path(self._context.out_dir, contact_nodes)

    def get(self, contact_nodes: int) -> tuple[MechanicsHeader, BodyMechanics]:
        """The mechanics in the file, with static condensation under the experiment's gravity. The file is written first
        if it does not exist, belongs to another body or gravity, or without --resume."""
        if contact_nodes not in self._known:
            self._known[contact_nodes] = self._kept(contact_nodes) or self._made(contact_nodes)
        return self._known[contact_nodes]

    def _kept(self, contact_nodes: int) -> tuple[MechanicsHeader, BodyMechanics] | None:
        from softprint.runtime.mechanics.mechanics_file import read_mechanics

        path = self.path(contact_nodes)
        if not self._context.resume or not path.is_file():
            return None
        try:
            header, mechanics = read_mechanics(path, self._body)
        except SoftprintError as error:
            log.warning("%s; it is made again now", error)
            return None
        same = (
            header.contact_nodes == contact_nodes
            and header.static_condensation
            and header.gravity == list(self._context.experiment.dynamics.gravity)
        )
        return (header, mechanics) if same else None

    def _made(self, contact_nodes: int) -> tuple[MechanicsHeader, BodyMechanics]:
        from softprint.runtime.mechanics.body_mechanics import compute_mechanics
        from softprint.runtime.mechanics.compliance.surface_compliance import n_columns
        from softprint.runtime.mechanics.mechanics_file import as_saved, save_mechanics

        context, path = self._context, self.path(contact_nodes)
        gravity, total = context.experiment.dynamics.gravity, n_columns(self._body, contact_nodes)
        with context.progress(total, "column", "surface compliance") as bar:
            mechanics = compute_mechanics(self._body, contact_nodes, True, gravity, bar.update)
        header = save_mechanics(path, mechanics, self._body, contact_nodes)
        context.say(f"{path} written.")
        return header, as_saved(mechanics)
