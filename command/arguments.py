"""Parser of the command line: every command with its arguments and the ``api`` function that it calls."""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import Field, fields
from typing import Any, NoReturn, get_type_hints

from .. import api
from ..engine.errors import FlexMapsError
from ..engine.extras import registry
from ..engine.fabrication.writers import export
from ..engine.params import SHOWN, ChooseParams, ObjectSettings, Settings, every_setting, format_value, sections
from ..engine.progress import Progress
from ..engine.runs import job
from . import extras, handles, painting, pressing, summary
from .sources import add_mesh_command, load_arguments

CHOOSE_SETTINGS = {f"choose.{f.name}" for f in fields(ChooseParams)}  # settings that make ``run`` compare layouts


class Parser(argparse.ArgumentParser):
    """Argument parser that reports wrong arguments in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"flexmaps: {message}; {self.prog} --help tells more\n")


def make_parser() -> argparse.ArgumentParser:
    made = Parser(prog="flexmaps", description="From a surface to flat, flexible panels, step by step or in one go.")
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True)

    _add_run_command(commands)
    add_mesh_command(
        commands, "check", _check, summary.print_report, "say what is wrong with a mesh; 2 where it cannot be made"
    )
    flat = add_mesh_command(commands, "layout", _layout, summary.print_report, "cut it into panels and flatten them")
    flat.add_argument(
        "--keep-seams", action="store_true", help="take the seams of the .blend file's object as they are"
    )
    if registry.has("choosing"):
        add_mesh_command(commands, "choose", _choose, summary.print_report, "compare many layouts, and take the best")
        for name in ("goal", "match", "panels"):
            setting = next(f for f in fields(ChooseParams) if f.name == name)
            _add_flag(commands.choices["choose"], name, f"choose.{name}", setting, get_type_hints(ChooseParams)[name])
    add_mesh_command(commands, "simulate", _simulate, summary.print_report, "the shape that the assembled panels take")
    add_mesh_command(
        commands, "optimise", _optimise, summary.print_report, "better spirals, from those that are there on"
    )
    commands.choices["optimise"].add_argument("--protect", metavar="NAME", help=f"spirals that stay exactly as they are: {painting.WHERE_HELP}")  # fmt: skip
    painting.add_arguments(
        add_mesh_command(
            commands, "paint", _paint, summary.print_report, "change spirals by hand: stiffer, softer, protected"
        )
    )
    handles.add_arguments(
        add_mesh_command(commands, "pull", _pull, summary.print_report, "pull at single spirals with a force"),
        add_mesh_command(
            commands, "wish", _wish, summary.print_report, "say where 'optimise' shall bring single spirals"
        ),
    )
    for name in {"layout", "choose", "simulate", "optimise"} & commands.choices.keys():
        commands.choices[name].add_argument("--out", metavar="FILE.blend", help="save the result in this Blender file")
    _add_writing_commands(commands)
    extras.add_commands(commands)
    pressing.add_command(commands)
    listed = commands.add_parser("settings", help="list every setting: name, default, bounds, unit")
    listed.add_argument("--json", action="store_true", help="as JSON")
    listed.set_defaults(
        is_resumable=False, run=lambda args, progress: _list_settings(), print_result=summary.print_settings
    )
    return made


def _add_run_command(commands: Any) -> None:
    """Add the command ``run``, the whole main job."""
    whole = add_mesh_command(
        commands, "run", _run, summary.print_report, "the whole way: sheets, a .blend, pictures and a report"
    )
    whole.epilog = (
        "Exit status: 0 all is done; 2 nothing could be made, one line says why; 3 the files are there, but it could not "
        "be optimised, or no equilibrium was found, see the warnings; 130 stopped; 1 a fault of the program."
    )
    whole.add_argument("--out", required=True, metavar="FOLDER", help="folder for everything that is written")
    whole.add_argument("--stop-after", choices=job.STAGE_NAMES, default=job.STAGE_NAMES[-1], metavar="STAGE",
                       help=f"last stage to run: {', '.join(job.STAGE_NAMES)}")  # fmt: skip
    whole.add_argument("--no-remesh", dest="remeshed", action="store_false",
                       help="refuse a mesh with faces that are not quads, instead of remeshing it")  # fmt: skip
    whole.add_argument(
        "--optimise", action="store_true", help="make the spirals match the surface better; takes longer"
    )
    whole.add_argument(
        "--choose", action="store_true",
        help="compare many layouts by the shape that their panels take, and take the best; so do --match, --panels and --goal",
    )  # fmt: skip
    whole.add_argument("--structure", action="store_true", help="examine it under the load cases (--cases) too")
    whole.add_argument("--pictures", action=argparse.BooleanOptionalAction, default=True, help="render the pictures")
    _add_formats(whole)
    _add_flags(whole)


def _add_writing_commands(commands: Any) -> None:
    """Add the commands that write files: ``export``, ``report`` and ``share``."""
    sheets = add_mesh_command(
        commands, "export", _export, summary.print_report, "nest the panels on sheets and write them"
    )
    sheets.add_argument("others", nargs="*", metavar="MESH", help="more pieces, on common sheets with the first")
    sheets.add_argument(
        "--copies", type=int, nargs="+", default=[], metavar="N", help="how often each piece is made, or all of them"
    )
    sheets.add_argument("--out", required=True, metavar="FOLDER", help="folder for the files")
    _add_formats(sheets)
    page = add_mesh_command(
        commands, "report", _report, summary.print_report, "simulate where needed; a page with figures, plots and maps"
    )
    page.add_argument(
        "--out", required=True, metavar="FOLDER", help="folder for report.html, report.json and the plots"
    )
    share = add_mesh_command(
        commands, "share", _share, summary.print_report, "simulate where needed; the piece in 3D as one page to send"
    )
    share.add_argument("--out", required=True, metavar="FILE.html", help="the page")


def _add_formats(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--formats", nargs="+", choices=export.FORMATS, default=list(export.DEFAULT_FORMATS), metavar="NAME",
                      help=f"kinds of files: {', '.join(export.FORMATS)} (default: {' '.join(export.DEFAULT_FORMATS)})")  # fmt: skip


# -- a flag for every setting -------------------------------------------------------------------------------


def _add_flags(parser: argparse.ArgumentParser) -> None:
    names = Counter(f.name for _, f in every_setting(Settings))
    for section, kind in sections(Settings).items():
        group = parser.add_argument_group(f"{section} settings")
        for f in fields(kind):  # type: ignore[arg-type]
            # put the section before names that occur in several sections, so that every flag is unique
            name = f"{section}_{f.name}" if names[f.name] > 1 else f.name
            _add_flag(group, name, f"{section}.{f.name}", f, get_type_hints(kind)[f.name])
        for name in kind.WERE:
            switch = argparse.BooleanOptionalAction
            group.add_argument(f"--{name}", dest=f"{section}.{name}", action=switch, help=argparse.SUPPRESS)


def _add_flag(group: argparse._ActionsContainer, name: str, dest: str, f: Field, kind: type) -> None:
    flag, meta = "--" + name.replace("_", "-"), f.metadata
    help = f"{meta['help']} (default {format_value(f, f.default)})" if kind in (int, float) else meta["help"]  # type: ignore[arg-type]
    help = help.replace("%", "%%")  # argparse treats % as a format character
    if kind is bool:
        group.add_argument(flag, dest=dest, action=argparse.BooleanOptionalAction, help=help)
    elif meta["choices"]:
        group.add_argument(flag, dest=dest, choices=[c[0] for c in meta["choices"]], help=help)
    else:
        metavar = {"mm": "MM", "\N{DEGREE SIGN}": "DEGREES", "GPa": "GPA"}.get(SHOWN[meta["unit"]][1], "N")
        group.add_argument(flag, dest=dest, metavar=metavar, help=help)  # ``api.load`` converts the text to a number


# -- one function for each command -------------------------------------------------------------------------------------


def _run(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    inputs = load_arguments(args)
    chosen = args.choose or args.stop_after == "choose" or not CHOOSE_SETTINGS.isdisjoint(inputs["settings"])
    return api.run(args.mesh, args.out, **inputs, remeshed=args.remeshed, optimised=args.optimise, chosen=chosen, structured=args.structure, stop_after=args.stop_after,
                   formats=args.formats, pictures=args.pictures, overwrite=args.overwrite, progress=progress)  # fmt: skip


def _check(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    piece = api.load(args.mesh, **load_arguments(args))
    if piece.made is not None:
        return api.report(piece)
    return {"checks": [finding.as_dict() for finding in api.check(piece)]}


def _layout(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    piece = api.load(args.mesh, **load_arguments(args))
    return _save_and_report(args, api.layout(piece, keep_seams=args.keep_seams, progress=progress))


def _choose(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    return _save_and_report(args, api.choose(api.load(args.mesh, **load_arguments(args)), progress=progress))


def _simulate(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    return _save_and_report(args, api.simulate(api.load(args.mesh, **load_arguments(args)), progress=progress))


def _optimise(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    piece = painting.protect(args, api.load(args.mesh, **load_arguments(args)))
    return _save_and_report(args, api.optimise(piece, progress=progress))


def _paint(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    return _save_and_report(args, painting.paint(args, api.load(args.mesh, **load_arguments(args)), progress))


def _pull(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    return _save_and_report(args, handles.pull(args, api.load(args.mesh, **load_arguments(args))))


def _wish(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    return _save_and_report(args, handles.wish(args, api.load(args.mesh, **load_arguments(args))))


def _save_and_report(args: argparse.Namespace, piece: Any) -> dict[str, Any]:
    if args.out:
        api.save(piece, args.out, overwrite=args.overwrite)
    return api.report(piece)


def _export(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    meshes = [args.mesh, *args.others]
    if len(args.copies) not in (0, 1, len(meshes)):
        raise FlexMapsError(f"--copies: give one number, or one for each of the {len(meshes)} pieces")
    if len(meshes) > 1 or args.copies:
        return _export_together(args, meshes, progress)
    piece = api.sheets(api.load(args.mesh, **load_arguments(args)), progress=Progress(progress).part(0.0, 0.9))
    written = api.export(piece, args.out, formats=args.formats, overwrite=args.overwrite)
    described = api.report(piece)
    described["sheets"]["files"] = [path.name for path in written]
    return described


def _export_together(args: argparse.Namespace, meshes: list[str], progress: Any) -> dict[str, Any]:
    """Export several pieces or copies on common sheets; return the pieces' names and copies, and the files."""
    copies = args.copies * (len(meshes) if len(args.copies) == 1 else 1) or [1] * len(meshes)
    pieces = []
    for mesh, count in zip(meshes, copies, strict=True):
        inputs = load_arguments(argparse.Namespace(**{**vars(args), "mesh": mesh}))
        inputs["settings"] = {**inputs["settings"], "export.copies": count}
        pieces.append(api.load(mesh, **inputs))
    written = api.export(pieces, args.out, formats=args.formats, overwrite=args.overwrite, progress=progress)
    args.print_result = summary.print_batch
    return {
        "files": [path.name for path in written],
        "pieces": [{"name": p.name, "copies": n} for p, n in zip(pieces, copies, strict=True)],
    }


def _report(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    reporter = Progress(progress)
    piece = _simulate_if_needed(args, reporter.part(0.0, 0.7))
    return api.report(piece, args.out, overwrite=args.overwrite, progress=reporter.part(0.7, 1.0))


def _share(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    reporter = Progress(progress)
    piece = _simulate_if_needed(args, reporter.part(0.0, 0.7))
    api.share(piece, args.out, overwrite=args.overwrite, progress=reporter.part(0.7, 1.0))
    return api.report(piece)


def _simulate_if_needed(args: argparse.Namespace, progress: Any) -> Any:
    """Return a Blender object that holds an up-to-date simulation, else the piece after simulating it."""
    import bpy

    from ..bridge.store import objects, states, stored_report

    piece = api.load(args.mesh, **load_arguments(args))
    if piece.uid is not None and not args.settings and not args.supports:
        obj = objects.find_by_uid(piece.uid)
        if "equilibrium" in stored_report.read(obj.data) and not states.is_stale(obj, bpy.context.scene, "equilibrium"):
            return obj
    return api.simulate(piece, progress=progress)


def _list_settings() -> dict[str, Any]:
    rows = {}
    for name, f in every_setting(ObjectSettings):
        factor, unit = SHOWN[f.metadata["unit"]]
        bounds = [None if f.metadata[k] is None else round(f.metadata[k] * factor, 9) for k in ("low", "high")]
        default = f.default * factor if isinstance(f.default, float) else f.default
        rows[name] = {
            "default": round(default, 9) if isinstance(default, float) else default,
            "unit": unit,
            "bounds": bounds,
            "choices": [c[0] for c in f.metadata["choices"]],
            "help": f.metadata["help"],
        }
    return {"settings": rows}
