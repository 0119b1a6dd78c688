"""The command line of the database: build, fit, report, validate, and the worker that build starts."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

from ..engine.errors import Cancelled, FlexMapsError
from ..engine.progress import Progress
from . import build, chunks, packs

ROOT = build.ROOT
FOLDER = ROOT / "build" / "database"
PACK = ROOT / "database" / "samples.npz"


def say(text: str) -> None:
    print(text, flush=True)


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="tools/dev.py database", description="The fine level of FlexMaps: sample, fit, report, validate."
    )
    commands = top.add_subparsers(dest="command", required=True)

    def common(name: str, text: str) -> argparse.ArgumentParser:
        p = commands.add_parser(name, help=text, description=text)
        p.add_argument("--dir", type=Path, default=FOLDER, help="folder of the chunks (default: build/database)")
        p.add_argument("--samples", type=int, default=1000, help="samples a spiral under the strain-targeted law")
        p.add_argument("--newton-samples", type=int, default=200, help="samples a spiral under the 1-5 N law")
        return p

    for name, text in (
        ("build", "Solve what is missing and gather it; goes on where it was stopped."),
        ("work", "One worker of build."),
    ):
        p = common(name, text)
        p.add_argument("--keep-samples", type=Path, default=None, metavar="DIR", help="also keep all raw samples there")
        if name == "build":
            p.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="workers on this machine")
            p.add_argument("--scheduler", default=None, metavar="ADDRESS", help="Dask scheduler to run on instead")
            p.add_argument("--root-on-workers", default=str(ROOT), help="the checkout's path on the Dask workers")
        else:
            p.add_argument("--stripe", default="0/1", help="which share of the chunks to begin with, e.g. 0/4")
    p = common("fit", "Fit the models from the samples and write the stiffness table.")
    p.add_argument("--table", action="store_true", help="also compute the nodes of the stiffness table (long)")
    p = common("report", "Held-out errors of the fits, as JSON and as scatter plots.")
    p.add_argument("--out", type=Path, default=ROOT / "out" / "database", help="folder of the report")
    text = "Solve whole assemblies as solids where results are missing, and compare the coarse models with them."
    p = commands.add_parser("validate", help=text, description=text)
    p.add_argument("--dir", type=Path, default=ROOT / "database" / "validation", help="folder of the results")
    p.add_argument("--only", default=None, metavar="TEXT", help="only cases with this text in their name")
    p.add_argument("--compare", action="store_true", help="solve nothing, only compare")
    p.add_argument("--arms", action="store_true", help="compare single arms of designs instead; takes seconds")
    p.add_argument("--models", default="arm,quick,rod", metavar="NAMES", help="what to compare: arm, quick, rod")
    p.add_argument("--json", type=Path, default=ROOT / "out" / "database" / "validation.json", help="the same as JSON")
    return top


def main(arguments: list[str]) -> int:
    """Run one command; 0 when it ran, 1 with a line of text when the user has to mend something."""
    options = parser().parse_args(arguments)
    try:
        return COMMANDS[options.command](options)
    except FlexMapsError as error:
        say(f"database: {error}")
        return 1
    except KeyboardInterrupt:
        say("Stopped. The same command goes on from here.")
        return 130


def _tasks(options: argparse.Namespace) -> list[chunks.Task]:
    if options.samples < 0 or options.newton_samples < 0 or options.samples + options.newton_samples == 0:
        raise FlexMapsError("Give a positive number of samples")
    if options.samples % chunks.CHUNK or options.newton_samples % chunks.CHUNK:
        raise FlexMapsError(f"Samples come in chunks of {chunks.CHUNK}: give a multiple of it")
    return chunks.tasks({"strain": options.samples, "newton": options.newton_samples})


def run_build(options: argparse.Namespace) -> int:
    if options.processes < 1:
        raise FlexMapsError("Give at least one process")
    wanted = _tasks(options)
    todo = build.pending(options.dir, wanted, PACK)
    say(f"{len(wanted) - len(todo)} of {len(wanted)} chunks are there")
    if todo and options.scheduler:
        build.run_dask(options.dir, todo, options.scheduler, options.root_on_workers, say)
    elif todo:
        extra = ["--samples", str(options.samples), "--newton-samples", str(options.newton_samples)]
        if options.keep_samples:
            extra += ["--keep-samples", str(options.keep_samples)]
        build.run_processes(options.dir, todo, options.processes, extra, say)
    left = build.pending(options.dir, todo)
    if left:
        raise FlexMapsError(f"{len(left)} chunks are still missing; run the same command to go on")
    say(f"{len(wanted)} chunks are there; gather and fit them with: tools/dev.py database fit")
    return 0


def run_work(options: argparse.Namespace) -> int:
    try:
        k, n = (int(x) for x in options.stripe.split("/"))
        if not 0 <= k < n:
            raise ValueError
    except ValueError:
        raise FlexMapsError(f"--stripe is '{options.stripe}'; it reads like 0/4") from None
    # stripes of all chunks, not of those still missing: every worker sees another moment of those
    every = _tasks(options)
    others = [task for number, task in enumerate(every) if number % n != k]
    # whoever is done early helps the others, from the far end
    mine = build.pending(options.dir, [*every[k::n], *reversed(others)], PACK)
    parent = os.getppid()
    # a worker whose starter was killed ends after its chunk; the next build goes on
    progress = Progress(stopped=lambda: os.getppid() != parent)
    try:
        build.work(options.dir, mine, options.keep_samples, progress)
    except Cancelled:
        return 1
    return 0


def run_fit(options: argparse.Namespace) -> int:
    from . import fits, table_file

    done = packs.gather(options.dir, PACK, _tasks(options))
    say(
        f"{done} chunks gathered into {PACK.name}"
        if done
        else f"No chunks in {options.dir}: fitting {PACK.name} as it stands"
    )
    if options.table:
        table_file.compute(options.dir / "table", Progress(lambda f, text: say(f"{100 * f:5.1f} %  {text}")))
    fits.write_parameters(PACK, say)
    return 0


def run_report(options: argparse.Namespace) -> int:
    from . import report

    report.write(PACK, options.out, say)
    return 0


def run_validate(options: argparse.Namespace) -> int:
    from . import validation, validation_arms

    if options.arms:
        for row in validation_arms.compare_arms():
            say(validation_arms.line(row))
        return 0
    if not options.compare:
        told: set[str] = set()

        def tell(fraction: float, text: str) -> None:
            if text not in told:
                say(f"{100 * fraction:5.1f} %  {text}")
            told.add(text)

        validation.run(options.dir, options.only, Progress(tell))
    chosen = tuple(options.models.split(","))
    if not set(chosen) <= set(validation.MODELS):
        raise FlexMapsError(f"--models is '{options.models}'; the models are {', '.join(validation.MODELS)}")
    rows = validation.compare(chosen, options.dir, options.only)
    for row in rows:
        say(validation.line(row))
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


COMMANDS = {"build": run_build, "work": run_work, "fit": run_fit, "report": run_report, "validate": run_validate}
