"""Run a whole exploration on the cores of this machine or on a cluster, and store it in a folder if required."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from ...cluster import Cluster
from ...errors import FlexMapsError
from ...own_files import Guard
from ...params import Settings
from ...progress import SILENT, Progress
from ...runs.outputs import FinalLayout
from ...runs.result import Result
from ...workers import Workers
from .candidate import EFFORT, ExplorationInput, StartSurface
from .explore import Exploration, explore
from .folder import ExplorationFolder
from .space import SearchSpace


def explore_piece(
    results: Mapping[int, Result],
    settings: Settings,
    question: SearchSpace,
    folder: str | Path | None = None,
    *,
    candidates: int = 64,
    scheduler: str | None = None,
    cores: int | None = None,
    effort: float = EFFORT,
    seed: int = 0,
    guard: Guard | None = None,
    progress: Progress = SILENT,
) -> Exploration:
    """Try many variants of a piece that has a layout.

    Parameters
    ----------
    results : results of the piece with each number of quads in ``question.quads``
    settings : settings of the piece
    question : variables, goals and minimised measures
    folder : folder for the journal, table, plot and pictures; candidates that are stored in it are not tried again
    candidates : largest number of candidates
    scheduler : address of a Dask cluster; default is this machine
    cores : number of this machine's cores to use; default is all
    effort : duration of a candidate's search, as a share of the optimiser's patience
    seed : seed of the random numbers; different seeds try different candidates
    guard : protects the user's own files in the folder
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : the folder or the cluster cannot be used, or supports and forces do not fit other numbers of quads
    Cancelled : the user cancels before a candidate is tried
    """
    first = next(iter(results.values()))
    if question.quads != (0,) and (first.supports is not None or first.force is not None):
        raise FlexMapsError("Supports and forces are set on the present quads; vary edge or height instead of quads")
    starts = {count: StartSurface(one.mesh, one.need(FinalLayout).flat.layout.cut) for count, one in results.items()}
    base = ExplorationInput(starts, settings, first.supports, first.force, effort)
    with ExitStack() as stack:
        kept = None if folder is None else stack.enter_context(ExplorationFolder(folder, base, question, guard))
        executor = stack.enter_context(Cluster(scheduler) if scheduler else Workers(cores))
        if kept is None:
            return explore(base, question, candidates, executor, progress, seed=seed)
        made = explore(base, question, candidates, executor, progress, known=kept.known, found=kept.add, seed=seed)
        kept.write(made)
    return made
