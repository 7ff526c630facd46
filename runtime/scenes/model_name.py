"""The name of a model: that of one correction, or of two. `ours+modes` is the correction of contact `ours` on the
internal correction `modes`, which it was not trained with: that one settles the body in place of static
condensation."""

from __future__ import annotations

from typing import NamedTuple

from softprint.runtime.errors import SoftprintError

ON = "+"  # no name in an experiment has it


class ModelName(NamedTuple):
    """internal: the part behind the plus, empty for none."""

    correction: str
    internal: str = ""

    @classmethod
    def of(cls, text: str) -> ModelName:
        """Raises SoftprintError where the name of one of two is missing."""
        correction, plus, internal = text.partition(ON)
        if plus and not (correction and internal):
            raise SoftprintError(
                f"model {text!r}: a correction of contact and an internal one are expected beside the {ON}, such as "
                f"ours{ON}modes"
            )
        return cls(correction, internal)

    def __str__(self) -> str:
        return ON.join(filter(None, self))

    def below(self, added_to: str) -> str:
        """The internal correction that contact acts on, empty for none; added_to: that of the training. Raises
        SoftprintError where the training had another."""
        if self.internal and added_to not in ("", self.internal):
            raise SoftprintError(
                f"model {str(self)!r}: {self.correction} was trained on the internal correction {added_to!r}, and acts "
                f"on no other: play {self.correction}"
            )
        return self.internal or added_to
