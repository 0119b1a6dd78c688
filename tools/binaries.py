"""Check that the compiled files in a wheel are for the system in its name, by the headers of the files.

``build_zip`` calls this for the wheels of every platform, since this machine can load only those of its own.
"""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path

# by the tags of wheels (packaging.python.org, platform compatibility tags): the format and the processors
ELF, PE, MACH = "ELF", "PE", "Mach-O"
X86, ARM = "x86_64", "arm64"
_ELF = {62: X86, 183: ARM}  # e_machine, at byte 18
_PE = {0x8664: X86, 0xAA64: ARM}  # IMAGE_FILE_HEADER.Machine, behind "PE\0\0", whose place stands at byte 60
_MACH = {0x01000007: X86, 0x0100000C: ARM}  # cputype
_NATIVE = re.compile(r"\.(so(\.\d+)*|pyd|dll|dylib)$")
_GLIBC = re.compile(rb"GLIBC_2\.(\d+)\0")


def kind(data: bytes) -> tuple[str, set[str]]:
    """The format of a compiled file and the processors that it is for; ("", set()) of anything else."""
    if data[:4] == b"\x7fELF":
        return ELF, {_ELF.get(struct.unpack_from("<H", data, 18)[0], "?")}
    if data[:2] == b"MZ" and len(data) > 64:
        (place,) = struct.unpack_from("<I", data, 60)
        if data[place : place + 4] == b"PE\0\0":
            return PE, {_PE.get(struct.unpack_from("<H", data, place + 4)[0], "?")}
    if data[:4] == b"\xcf\xfa\xed\xfe":
        return MACH, {_MACH.get(struct.unpack_from("<I", data, 4)[0], "?")}
    if data[:4] == b"\xca\xfe\xba\xbe":  # one for several processors
        (count,) = struct.unpack_from(">I", data, 4)
        return MACH, {_MACH.get(struct.unpack_from(">I", data, 8 + 20 * k)[0], "?") for k in range(count)}
    return "", set()


def wanted(tag: str) -> tuple[str, set[str]]:
    """Return the required format and processors of the files in a wheel with a platform tag."""
    if tag.startswith("win"):
        return PE, {ARM if "arm64" in tag else X86}
    if tag.startswith("macosx"):
        return MACH, {ARM, X86} if "universal2" in tag else {ARM if tag.endswith("arm64") else X86}
    return ELF, {ARM if tag.endswith("aarch64") else X86}


def glibc_minor(tag: str) -> int | None:
    """The second number of the C library that a tag of Linux promises to be enough; None of other systems."""
    found = re.match(r"manylinux_2_(\d+)_", tag)
    return int(found[1]) if found else {"manylinux2014": 17, "manylinux2010": 12}.get(tag.partition("_")[0])


def faults(wheel: Path) -> list[str]:
    """The files of a wheel that are for another system than its name says."""
    tags = wheel.name.removesuffix(".whl").split("-")[-1].split(".")
    found = []
    with zipfile.ZipFile(wheel) as content:
        for name in content.namelist():
            if not _NATIVE.search(name):
                continue
            data = content.read(name)
            form, processors = kind(data)
            if tags == ["any"]:
                found.append(f"{wheel.name}: {name} is compiled, and the wheel is said to be for any system")
            elif not any(form == wanted(tag)[0] and processors >= wanted(tag)[1] for tag in tags):
                found.append(
                    f"{wheel.name}: {name} is {form or 'no compiled file'} for {', '.join(sorted(processors)) or '?'}"
                )
            oldest = max((promised for tag in tags if (promised := glibc_minor(tag)) is not None), default=None)
            newest = max(map(int, _GLIBC.findall(data)), default=0)
            if oldest is not None and form == ELF and newest > oldest:
                found.append(f"{wheel.name}: {name} needs glibc 2.{newest}, and the wheel promises 2.{oldest}")
    return found
