"""The one entry for people: ``python3 tools/dev.py demo``, ``test``, ``run``, ``build``, ``bench``, ``lint``.

Makes its own environment (Blender as a module, numpy, scipy, ...) beside the sources on the first call, and runs every
command inside it. Only the standard library is used here, in words that any Python can read, however old, so that a
wrong Python gets a clear line instead of a traceback.
"""

from __future__ import print_function

import hashlib
import os
import re
import subprocess
import sys
import threading
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TOOLS = os.path.join(ROOT, "tools")
# Pythons that Blender comes with
SUPPORTED = ((3, 11), (3, 13))
# the Blender as a module for each
BLENDER = {(3, 11): "Blender 4.5 LTS", (3, 13): "Blender 5.2 LTS"}
USAGE = """FlexMaps: from a quad mesh to flat sheets that spring into its shape.

  python3 tools/dev.py demo                     main job on a built-in surface; results in out/
  python3 tools/dev.py run MESH --edge 20 --out DIR
                                                main job on your mesh (.obj .off .ply .stl .blend), 20 mm quads
  python3 tools/dev.py test [engine|tools|database|blender|install|page|window ...] [--thorough] [-k NAME]
                                                lint, types and the quick tests; --thorough: all of them
  python3 tools/dev.py build [--platform all]   build the extension's zips in dist/, one for each line of Blender
  python3 tools/dev.py release VERSION [--dry-run]
                                                set the version; build and test zips, repository and package
  python3 tools/dev.py lock                     renew the checksums of all downloaded packages
  python3 tools/dev.py gallery [NAME ...]       make the objects and pictures of docs/gallery.md (half an hour)
  python3 tools/dev.py site                     build the documentation in docs/site, check its links and code
  python3 tools/dev.py bench NAME               measure: far, zoo, ...
  python3 tools/dev.py database build|fit|report|validate
                                                simulate spirals and fit the stiffness table (hours; it resumes)
  python3 tools/dev.py lint [--fix]             ruff and mypy only; --fix formats the sources first
  python3 tools/dev.py measures                 check imports, lengths of files and functions, numbers without a comment
  python3 tools/dev.py setup                    make the environment, nothing else
  python3 tools/dev.py python FILE ...          run a script inside the environment

Before the command: --python 3.11 or --python 3.13 chooses the Python (and so Blender 4.5 or 5.2).
"""


class Stop(Exception):
    """Something a person must mend; its text is the one line they see."""


def say(text):
    """Print a line at once, also when the output goes to a file."""
    print(text)
    sys.stdout.flush()


def load_package():
    """Load this checkout as the package ``flexmaps``, once, and return it.

    The repository's root is the package's root, so it must never be importable from ``sys.path``: every class would
    exist twice. This is the only place that loads it.
    """
    if "flexmaps" in sys.modules:
        return sys.modules["flexmaps"]
    import importlib.util

    spec = importlib.util.spec_from_file_location(
        "flexmaps", os.path.join(ROOT, "__init__.py"), submodule_search_locations=[ROOT]
    )
    package = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
    sys.modules["flexmaps"] = package
    spec.loader.exec_module(package)  # type: ignore[union-attr]
    return package


# ---- which Python


def version_of(python):
    """(major, minor) of an interpreter, or None where it does not run."""
    try:
        code = "import sys; print('%d %d' % sys.version_info[:2])"
        out = subprocess.check_output([python, "-c", code], stderr=subprocess.STDOUT)
        major, minor = out.split()[-2:]
        return int(major), int(minor)
    except (OSError, ValueError, subprocess.CalledProcessError):
        return None


def candidates(version):
    """Paths where a Python of this version may be, likeliest first."""
    name = "python%d.%d" % version
    dotted = "%d.%d" % version
    yield environment_python(version)
    for folder in os.environ.get("PATH", "").split(os.pathsep) + ["/usr/local/bin", "/opt/homebrew/bin", "/usr/bin"]:
        yield os.path.join(folder, name)
        yield os.path.join(folder, name + ".exe")
    home = os.path.expanduser("~")
    for folder, pattern, inside in (
        (os.path.join(os.environ.get("PYENV_ROOT", os.path.join(home, ".pyenv")), "versions"), dotted, "bin/python"),
        (os.path.join(home, ".local", "share", "uv", "python"), "cpython-" + dotted, "bin/python3"),
        (
            os.path.join(os.environ.get("LOCALAPPDATA", home), "Programs", "Python"),
            "Python%d%d" % version,
            "python.exe",
        ),
    ):
        if os.path.isdir(folder):
            for entry in sorted(os.listdir(folder), reverse=True):
                if entry == pattern or entry.startswith(pattern + "."):
                    yield os.path.join(folder, entry, *inside.split("/"))


def find_python(version):
    """Path of a working Python of this version, or None."""
    for path in candidates(version):
        if os.path.isfile(path) and version_of(path) == version:
            return path
    return None


def choose_python(wanted):
    """The interpreter to use and its version; ``wanted`` is a version or None for the best that is there."""
    running = tuple(sys.version_info[:2])
    if wanted is None and running in SUPPORTED or wanted == running:
        return sys.executable, running
    for version in SUPPORTED if wanted is None else (wanted,):
        path = find_python(version)
        if path:
            if wanted is None:
                say("This is Python %d.%d; using Python %d.%d at %s" % (running + version + (path,)))
            return path, version
    if wanted is None:
        raise Stop(
            "FlexMaps needs Python 3.11 (Blender 4.5 LTS) or 3.13 (Blender 5.2 LTS); this is %d.%d and no other was "
            "found. Install one of them and run the same command again." % running
        )
    raise Stop("Python %d.%d was not found; install it, or leave --python away." % wanted)


# ---- the environment


def environment_folder(version):
    return os.path.join(ROOT, ".venv-%d.%d" % version)


def environment_python(version):
    inside = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
    return os.path.join(environment_folder(version), *inside)


def requirements():
    """Return the name of the pinned requirements with checksums, and a text that changes whenever a pin changes."""
    folder = os.path.join(ROOT, "requirements")
    text = ""
    for name in ("dev.txt", "runtime.txt"):
        with open(os.path.join(folder, name)) as stream:
            text += stream.read()
    return os.path.join(folder, "locked.txt"), text


def stamp_of(version):
    return hashlib.sha256(("%d.%d\n" % version + requirements()[1]).encode("utf-8")).hexdigest()


def is_ready(version):
    try:
        with open(os.path.join(environment_folder(version), "flexmaps-stamp")) as stream:
            return stream.read() == stamp_of(version) and os.path.isfile(environment_python(version))
    except (IOError, OSError):
        return False


def running_satisfies():
    """Whether the running Python already has every pinned package, so that no environment need be made."""
    if tuple(sys.version_info[:2]) not in SUPPORTED:
        return False
    from importlib import metadata

    here = "%d.%d" % sys.version_info[:2]
    for line in requirements()[1].splitlines():
        line = line.split("#")[0]
        pin = re.match(r"\s*([\w-]+)==(\S+)\s*(?:;.*\"([\d.]+)\")?", line)
        if pin and pin.group(3) in (None, here):
            try:
                if metadata.version(pin.group(1)) != pin.group(2):
                    return False
            except metadata.PackageNotFoundError:
                return False
    return True


class Ticker(threading.Thread):
    """Shows what pip is at: a line for every big download, and one every 20 seconds of silence."""

    def __init__(self):
        threading.Thread.__init__(self)
        self.daemon = True
        self.start_time = self.last = time.time()
        self.text = "looking up packages"
        self.done = threading.Event()

    def show(self, text):
        self.text, self.last = text, time.time()
        say("  %3d s  %s" % (self.last - self.start_time, text))

    def line(self, line):
        """Handle one line of pip's output."""
        if line.startswith("Collecting ") or line.startswith("Requirement already"):
            return
        size = re.match(r"\s*(?:Downloading|Using cached) (?:\S*/)?([\w.]+-[\w.]+)-\S+ \(([\d.]+) (kB|MB|GB)\)", line)
        if size and (size.group(3) == "GB" or size.group(3) == "MB" and float(size.group(2)) >= 10):
            self.show("%s (%.0f %s)" % (size.group(1), float(size.group(2)), size.group(3)))
        elif line.startswith("Installing collected"):
            self.show("installing %d packages" % (line.count(",") + 1))

    def run(self):
        while not self.done.wait(1.0):
            if time.time() - self.last > 20:
                self.last = time.time()
                say("  %3d s  ... %s" % (self.last - self.start_time, self.text))


def make_environment(python, version):
    """Make or mend the environment for this version; an interrupted call is taken up where it stopped."""
    folder, target = environment_folder(version), environment_python(version)
    name = os.path.basename(folder)
    say(
        "Setting up %s for %s (first time only: about 700 MB to download, 2-5 minutes)" % (name, BLENDER[version])
        if not os.path.isdir(folder)
        else "Bringing %s up to date" % name
    )
    if version_of(target) != version or subprocess.call([target, "-c", "import pip"], stderr=subprocess.PIPE) != 0:
        made = subprocess.Popen(
            [python, "-m", "venv", "--clear", folder], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        text = made.communicate()[0].decode("utf-8", "replace").strip()
        if made.returncode:
            raise Stop(
                "%s cannot make a virtual environment: %s. On Debian or Ubuntu: apt install python%d.%d-venv"
                % ((python, " ".join(text.split())[:200]) + version)
            )
    log_path = os.path.join(folder, "setup.log")
    ticker = Ticker()
    ticker.start()
    pip = [target, "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--prefer-binary"]
    lines = []
    with open(log_path, "w") as log:
        process = subprocess.Popen(
            pip + ["--progress-bar", "off", "--require-hashes", "-r", requirements()[0]],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
        )
        for line in process.stdout:  # type: ignore[union-attr]
            log.write(line)
            lines.append(line.rstrip())
            ticker.line(line)
        code = process.wait()
    ticker.done.set()
    if code:
        for line in [x for x in lines if "ERROR" in x][-5:] or lines[-5:]:
            say("    " + line)
        raise Stop(
            "The environment could not be installed (all of pip's output: %s). Mend the cause, then run the same command "
            "again: it goes on from here." % log_path
        )
    with open(os.path.join(folder, "flexmaps-stamp"), "w") as stream:
        stream.write(stamp_of(version))
    say("  %3d s  ready" % (time.time() - ticker.start_time))


def enter_environment(arguments, wanted):
    """Return if this process already runs in a complete environment; else run the same command in one and exit."""
    if (wanted is None or wanted == tuple(sys.version_info[:2])) and running_satisfies():
        return
    python, version = choose_python(wanted)
    if not is_ready(version):
        make_environment(python, version)
    if os.environ.get("FLEXMAPS_ENTERED") == str(version):
        raise Stop("%s is damaged: delete that folder and run again." % environment_folder(version))
    target = environment_python(version)
    environment = dict(os.environ, FLEXMAPS_ENTERED=str(version))
    environment.pop("PYTHONPATH", None)
    environment.pop("PYTHONHOME", None)
    command = [target, os.path.join(TOOLS, "dev.py")] + arguments
    if os.name == "nt":
        sys.exit(subprocess.call(command, env=environment))
    os.execve(target, command, environment)


# ---- the commands


def call(module, arguments):
    """Import ``tools/<module>.py`` and call its ``main(arguments)``; its return value is the exit status."""
    if not os.path.isfile(os.path.join(TOOLS, module + ".py")):
        there = sorted(n[6:-3] for n in os.listdir(TOOLS) if n.startswith("bench_") and n.endswith(".py"))
        raise Stop("There is no tools/%s.py. Benches that are there: %s." % (module, ", ".join(there) or "none"))
    import importlib

    if TOOLS not in sys.path:
        sys.path.insert(0, TOOLS)
    load_package()
    return importlib.import_module(module).main(arguments)


def run_script(arguments):
    """Run a Python file inside the environment, with the package ``flexmaps`` at hand."""
    import runpy

    if not arguments:
        raise Stop("python needs the path of a script")
    load_package()
    sys.argv = arguments
    runpy.run_path(arguments[0], run_name="__main__")
    return 0


def dispatch(command, rest):
    if command in ("demo", "run"):
        return call("main_job", [command] + rest)
    if command in ("test", "lint"):
        return call("checks", [command] + rest)
    if command == "build":
        return call("build_zip", rest)
    if command in ("release", "lock"):
        return call(command, rest)
    if command == "measures":
        return call("measures", rest)
    if command == "gallery":
        return call("gallery", rest)
    if command == "site":
        return call("website", rest)
    if command == "bench":
        if not rest or rest[0].startswith("-"):
            return call("bench_" + (rest[0] if rest else "NAME"), [])
        return call("bench_" + rest[0], rest[1:])
    if command == "database":
        return call("main_database", rest)
    if command == "python":
        return run_script(rest)
    return 0  # setup


COMMANDS = (
    "demo",
    "run",
    "test",
    "lint",
    "build",
    "release",
    "lock",
    "gallery",
    "site",
    "bench",
    "database",
    "measures",
    "python",
    "setup",
)


def main(arguments):
    wanted, rest = None, list(arguments)
    if rest[:1] == ["--python"]:
        if len(rest) < 2 or rest[1] not in ["%d.%d" % v for v in SUPPORTED]:
            raise Stop("--python takes 3.11 or 3.13")
        wanted = tuple(int(n) for n in rest[1].split("."))
        rest = rest[2:]
    if not rest or rest[0] in ("-h", "--help", "help"):
        print(USAGE)
        return 0
    if rest[0] not in COMMANDS:
        raise Stop("'%s' is no command; there are: %s" % (rest[0], ", ".join(COMMANDS)))
    enter_environment(list(arguments), wanted)
    return dispatch(rest[0], rest[1:])


def leave(status):
    """End the process. With Blender inside, without its clean-up: that complains for pages and can wait for ever."""
    sys.stdout.flush()
    sys.stderr.flush()
    if "bpy" in sys.modules:
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    try:
        leave(main(sys.argv[1:]))
    except Stop as stop:
        sys.stderr.write("dev.py: %s\n" % stop)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.stderr.write("\nStopped. The same command goes on from here.\n")
        sys.exit(130)
