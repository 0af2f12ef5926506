"""The C compiles without a warning, the pure part stays pure, and a machine without compiler is told what to do."""

import re
import shutil
import subprocess
import sys

import pytest

from firmware.virtual import native as module
from firmware.virtual.native import (
    FIRMWARE,
    FLAGS,
    WARNINGS,
    CompilerError,
    compile_into,
    compiler,
    headers,
    native,
    sources,
)
from tests.tools import miss

PURE = ("link", "drive", "sensor", "motor", "cart")
CHECKED = {"avr8": (*PURE, "avr"), "native": ("virtual", "fuzz")}  # by cppcheck, with all folders in them


@pytest.mark.parametrize("path", sources(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_c_compiles_without_warnings(path, tmp_path):
    flags = [flag for flag in FLAGS if flag != "-shared"]
    strict = ["-Wdouble-promotion"] if path.parent.name in PURE else []
    command = [compiler(), *flags, *WARNINGS, *strict, "-c", str(path), "-o", str(tmp_path / "object")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.skipif(shutil.which("avr-gcc") is None, reason="no avr-gcc here")
@pytest.mark.parametrize("path", [p for p in sources() if p.parent.name in PURE], ids=lambda path: path.name)
def test_firmware_compiles_for_the_microcontroller(path, tmp_path):
    command = [
        "avr-gcc",
        "-mmcu=atmega32",
        "-std=c11",
        "-Os",
        *WARNINGS,
        "-c",
        str(path),
        "-o",
        str(tmp_path / "object"),
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("platform", CHECKED)
def test_cppcheck_finds_nothing(platform):
    if shutil.which("cppcheck") is None:
        miss("no cppcheck here")
    checks = ["--enable=warning,portability,performance", f"--platform={platform}", "--std=c11", "-DBUILD=1u"]
    paths = [str(FIRMWARE / folder) for folder in CHECKED[platform]]
    command = ["cppcheck", "--quiet", "--error-exitcode=1", *checks, *paths]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_no_c_is_left_unchecked():
    folders = {path.relative_to(FIRMWARE).parts[0] for path in FIRMWARE.rglob("*.[ch]")}
    assert folders == {folder for checked in CHECKED.values() for folder in checked}


def test_firmware_uses_floats_and_no_libm():
    for path in [*sources(), *headers()]:
        if path.parent.name in PURE:
            code = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(), flags=re.DOTALL)
            assert not re.search(r"\bdouble\b|math\.h|\bmalloc\b|\bprintf\b", code), path
            assert not re.search(r"\d\.\d+(?![\df])", code), f"{path}: a double constant"


def test_firmware_keeps_no_state_of_its_own(tmp_path):
    """No writable data: every state is a structure that the caller owns."""
    nm = shutil.which("nm")
    if nm is None:
        miss("no nm here")
    for path in sources():
        if path.parent.name in PURE:
            target = tmp_path / "object"
            subprocess.run([compiler(), "-O2", "-std=c11", "-c", str(path), "-o", str(target)], check=True)
            listing = subprocess.run([nm, str(target)], capture_output=True, text=True, check=True).stdout
            assert not re.search(r" [bBdDC] ", listing), f"{path.name}:\n{listing}"


def test_packed_structures_are_read_from_the_header():
    ffi = native().ffi
    sizes = {
        "odometry": 6,
        "balance": 9,
        "power": 12,
        "status": 16,
        "sonar": 16,
        "infrared": 16,
        "drive": 10,
        "motors": 9,
        "powers": 12,
    }
    assert {name: ffi.sizeof(f"struct {name}_payload") for name in sizes} == sizes


def test_a_missing_compiler_is_named(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(CompilerError, match=r"no C compiler 'no-such-compiler'.*apt-get.*CC"):
        compiler()


def test_a_broken_source_is_named(monkeypatch, tmp_path):
    broken = tmp_path / "broken.c"
    broken.write_text("int f(void) { return missing; }\n")
    monkeypatch.setattr(module, "sources", lambda folders: [broken])
    with pytest.raises(CompilerError, match=r"broken\.c:1:"):
        compile_into(tmp_path / "cache" / "crunch.so")
    assert not list((tmp_path / "cache").glob("*.so"))


def test_processes_may_build_at_the_same_time(tmp_path):
    code = (
        f"import platformdirs; platformdirs.user_cache_dir = lambda name: {str(tmp_path)!r}\n"
        "from firmware.virtual import VirtualCrunch, load_world\n"
        "print(len(VirtualCrunch(load_world('demo')).advance(1.0)))"
    )
    running = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(3)]
    said = [process.communicate()[0] for process in running]
    assert [process.returncode for process in running] == [0, 0, 0]
    assert len(set(said)) == 1
    assert sorted(path.suffix for path in (tmp_path / "firmware").iterdir()) == [".h", ".h", ".so"]
