"""The result of a run: the outputs of the stages so far, all of them up to date.

An output is out of date, and is dropped, when a value or a setting that it was made from has changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..fabrication.assembly_check import AssemblyCheck
from ..fabrication.estimates import Estimates
from ..fabrication.sheets import CutSheets
from ..optimisation.match_limits import MatchLimits
from ..optimisation.optimise import Optimisation
from ..optimisation.wishes import Wishes
from ..params import Settings
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..simulation.simulate import Simulation
from ..spirals.design import SpiralDesign
from ..surface.checking.check import Finding
from ..surface.mesh import QuadMesh
from .outputs import (
    NO_USER_INPUT,
    DesignVersion,
    FinalLayout,
    MakingEstimate,
    OptimisationRecord,
    SheetPlan,
    SimulatedShape,
    StageOutput,
    Surface,
    TracedLayout,
    UserInput,
)
from .stages import MISSING, STAGES, TABLE, dependents

O = TypeVar("O", bound=StageOutput)
_MADE = {member for stage in TABLE for member in stage.makes}


@dataclass(frozen=True)
class Result:
    """The outputs of all stages that have run. Scripts read values from the properties; None if a stage has not run.

    surface, user : inputs of the stages, with the properties ``mesh``, ``findings``, ``supports``, ``force``,
        ``wishes`` and ``protected``
    outputs : outputs of the stages by ``StageOutput.name``; all are up to date
    lost : error by the name of an output that existed and can no longer be used; raised if that output is needed
    undone : reason why a requested stage failed, by stage; removed when the stage succeeds later
    seconds : wall time of every stage that has run
    layout : the traced patches
    flat : flat patches of the spirals, whose shapes the optimiser may have changed; without spirals those of the layout
    choice : the proposed layouts, and the index of the chosen one
    design : the spirals, optimised if that stage has run
    optimisation : history and outcome of the optimisation
    simulation : shape of the assembled piece at equilibrium
    limits : reasons why the shape misses the target
    scan : comparison of a scan with the simulated shape, or with the target if there is no simulation
    structure : response of the piece to its loads
    sheets : the sheets to cut
    estimates : time, mass and cost of making the piece
    assembly : how hard each seam is to join
    """

    surface: Surface
    user: UserInput = NO_USER_INPUT
    outputs: Mapping[str, StageOutput] = field(default_factory=dict)
    lost: dict[str, FlexMapsError] = field(default_factory=dict)
    undone: dict[str, Finding] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def get(self, kind: type[O]) -> O | None:
        """Return the output of a class; None if there is none."""
        found = self.outputs.get(kind.name)
        assert found is None or isinstance(found, kind)
        return found

    def need(self, kind: type[O]) -> O:
        """Return the output of a class; raise ``FlexMapsError`` with the reason if there is none."""
        found = self.get(kind)
        if found is None:
            raise self.lost.get(kind.name, FlexMapsError(MISSING[kind.name]))
        return found

    def missing(self, name: str) -> tuple[str, ...]:
        """Return the names of the stages to run, in order, to get an output; empty if it exists.

        Raises ``FlexMapsError`` if the output was lost.
        """
        if self.value(name) is not None:
            return ()
        if name in self.lost:
            raise self.lost[name]
        makers = [stage for stage in TABLE if not stage.asked and name in stage.makes]
        before = [earlier for stage in makers for need in stage.needs for earlier in self.missing(need)]
        wanted = {*before, *(stage.name for stage in makers)}
        return tuple(stage.name for stage in TABLE if stage.name in wanted)

    def value(self, name: str) -> object:
        """Return the present value of an output or input, by its name in ``StageOutput.inputs``; None if missing."""
        for holder in (self.outputs.get(name), self.user, self.surface):
            if hasattr(holder, name):
                return getattr(holder, name)
        return None

    def inputs(self, *names: str) -> dict[str, object]:
        """Return the present values of outputs and inputs, by name, for ``StageOutput.inputs``."""
        return {name: self.value(name) for name in names}

    def with_outputs(self, *outputs: StageOutput) -> Result:
        """Return the result with new outputs, and without the outputs made from those that they replace."""
        made = {output.name: output for output in outputs}
        return replace(self, outputs={**self.outputs, **made})._failures_forgotten(made)._pruned()

    def with_surface(self, **changes: Any) -> Result:
        """Return the result with changed members of ``Surface``, and without the outputs made from old values."""
        return replace(self, surface=replace(self.surface, **changes))._pruned()

    def with_user(self, **changes: Any) -> Result:
        """Return the result with changed members of ``UserInput``, and without the outputs made from old values."""
        return replace(self, user=replace(self.user, **changes))._pruned()

    def without(self, *names: str) -> Result:
        """Return the result without some outputs, all outputs made from these, and records of failures to make them."""
        kept = {name: output for name, output in self.outputs.items() if name not in names}
        return replace(self, outputs=kept)._failures_forgotten(names)._pruned()

    def _failures_forgotten(self, names: Iterable[str]) -> Result:
        gone = {*names} | dependents(names)
        lost = {name: why for name, why in self.lost.items() if name not in gone}
        undone = {stage: why for stage, why in self.undone.items() if not gone.intersection(STAGES[stage].makes)}
        return replace(self, lost=lost, undone=undone)

    def without_outdated(self, settings: Settings) -> Result:
        """Return the result without the outputs made with other settings; spirals that stay get the new settings.

        settings : the present settings
        """
        left = self.without(*(name for name, output in self.outputs.items() if output.differs(settings)))
        version = left.get(DesignVersion)
        if version is None or version.design.params == settings.spiral:
            return left
        return left.with_outputs(replace(version, design=replace(version.design, params=settings.spiral)))

    def _pruned(self) -> Result:
        """Return the result without outputs that are out of date."""
        for name in (name for stage in TABLE for name in stage.makes if name in self.outputs):
            now = self.outputs[name].inputs
            if not all(_is_same_value(value, self.value(member)) for member, value in now.items()):
                return self.without(name)
        return self

    def __getattr__(self, name: str) -> Any:
        """Return the value of an output that has no property of its own; None if its stage has not run."""
        if name in _MADE:
            return self.value(name)
        raise AttributeError(f"A result has no '{name}'")

    # -- the values, None if they are missing --------------------------------------------------------------------------

    @property
    def findings(self) -> list[Finding]:
        return self.surface.findings

    @property
    def mesh(self) -> QuadMesh:
        return self.surface.mesh

    @property
    def supports(self) -> Int[np.ndarray, " held"] | None:
        return self.user.supports

    @property
    def force(self) -> Float[np.ndarray, "quads 3"] | None:
        return self.user.force

    @property
    def wishes(self) -> Wishes | None:
        return self.user.wishes

    @property
    def protected(self) -> Int[np.ndarray, " kept"] | None:
        return self.user.protected

    @property
    def layout(self) -> PatchLayout | None:
        return None if (found := self.get(TracedLayout)) is None else found.layout

    @property
    def flat(self) -> FlatPatches | None:
        if self.design is not None:
            return self.design.flat
        return None if (found := self.get(FinalLayout)) is None else found.flat

    @property
    def design(self) -> SpiralDesign | None:
        return None if (found := self.get(DesignVersion)) is None else found.design

    @property
    def optimisation(self) -> Optimisation | None:
        return None if (found := self.get(OptimisationRecord)) is None else found.optimisation

    @property
    def simulation(self) -> Simulation | None:
        return None if (found := self.get(SimulatedShape)) is None else found.simulation

    @property
    def limits(self) -> MatchLimits | None:
        return None if (found := self.get(SimulatedShape)) is None else found.limits

    @property
    def sheets(self) -> CutSheets | None:
        return None if (found := self.get(SheetPlan)) is None else found.sheets

    @property
    def estimates(self) -> Estimates | None:
        return None if (found := self.get(MakingEstimate)) is None else found.estimates

    @property
    def assembly(self) -> AssemblyCheck | None:
        return None if (found := self.get(MakingEstimate)) is None else found.assembly


def _is_same_value(one: object, other: object) -> bool:
    """Return whether two values are the same object, or arrays with equal numbers."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return one is other
