"""The publication's optimiser, the baseline of ``bench optimise``: L-BFGS-B (FlexMaps section 7)."""

from __future__ import annotations

import numpy as np
from flexmaps.engine.newton import CONVERGED, ITERATIONS, TIME
from flexmaps.engine.optimisation.gauss_newton import MAX_NEWTON_ITERATIONS, Accepted, SearchRecord
from flexmaps.engine.optimisation.inverse import DesignPoint, InverseProblem
from flexmaps.engine.params import OptimiseParams
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.threads import one_thread


@one_thread
def lbfgs(
    problem: InverseProblem,
    start: DesignPoint,
    params: OptimiseParams,
    trace: SearchRecord,
    accepted: Accepted,
    progress: Progress = SILENT,
) -> DesignPoint:
    """Run L-BFGS-B with an equilibrium at every evaluation, as in the publication; parameters as of ``run_gauss_newton``.

    Without an equilibrium, and beyond the limits of flat shapes, the objective is replaced by ten times the start's.
    """
    from scipy.optimize import minimize

    best = last = start

    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best, last
        done = min(trace.evaluations / (1.2 * params.iterations), 1.0)
        within = progress.at(done, f"RMSE {1e3 * best.mismatch.rmse:.4g} mm")
        trace.evaluations += 1
        if problem.work.is_over:
            raise StopIteration
        point = problem.point_at(x, last.equilibrium.pose, within, MAX_NEWTON_ITERATIONS)
        if not (point.equilibrium.converged and np.isfinite(point.value)):
            trace.unstable += 1
            return 10.0 * start.value, np.zeros_like(x)
        last = point
        point.precompute(within)
        gradient = point.gradient.copy()
        if point.value < best.value:
            best = point
            trace.note(point)
            accepted(point)
        return point.value, gradient

    options = {"maxiter": params.iterations, "maxfun": 4 * params.iterations, "ftol": 0.0, "gtol": 0.0}
    bounds = [(0.0, 1.0)] * start.x.size
    try:
        found = minimize(value, start.x, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        # status 1 is the iteration limit; 2, a line search without a decrease, is the normal end with these options
        trace.ended = ITERATIONS if found.status == 1 else CONVERGED
    except StopIteration:
        trace.ended = TIME
    return best
