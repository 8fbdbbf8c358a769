"""What claims are told of doubles, of one state and of many in lanes alike; see `Look`."""

from __future__ import annotations

from typing import Any, ClassVar

from eomcheck.formulations import Formulation


class AtDoubles:
    """States in doubles: `at` is the evaluation there."""

    at: Any
    exact: ClassVar[bool] = False
    others: ClassVar[tuple] = ()

    @property
    def free(self) -> Any:
        """The states themselves: their velocities were given."""
        return self.at

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.at.scene.coordinate_names

    def part_sensitivity(self, formulation: Formulation, part: str) -> Any:
        """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`."""
        raise NotImplementedError

    def vdot_sensitivity(self, formulation: Formulation) -> Any:
        """Return κ · scale of v̇ by `formulation`."""
        return self.part_sensitivity(formulation, "vdot")

    def multiplier_sensitivity(self, formulation: Formulation) -> Any:
        """Return κ · scale of λ by `formulation`."""
        return self.part_sensitivity(formulation, "multipliers")
