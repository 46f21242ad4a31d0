"""What differs between Linux, macOS and Windows: modules and names of POSIX, names of files, encodings of output."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import truearm

SOURCE = Path(truearm.__file__).parent
POSIX_MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty"}
POSIX_NAMES = {
    "os": {
        "fork", "forkpty", "getuid", "geteuid", "getgid", "chown", "lchown", "fchmod", "fchown", "mkfifo", "mknod",
        "killpg", "setsid", "getpgid", "nice", "uname", "statvfs", "sysconf", "sched_getaffinity", "getloadavg",
        "pread", "pwrite", "sendfile", "wait", "WNOHANG", "O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY",
    },
    "signal": {"SIGHUP", "SIGKILL", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGPIPE", "SIGQUIT", "setitimer", "alarm"},
}  # fmt: skip


def guarded_names(nodes: list[ast.AST]) -> set[str]:
    """Names that the module asks for by `hasattr` or `getattr` before it uses them."""
    calls = (node for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name))
    asked = (call.args[1] for call in calls if call.func.id in ("hasattr", "getattr") and len(call.args) > 1)
    return {name.value for name in asked if isinstance(name, ast.Constant)}


def for_one_system(nodes: list[ast.AST]) -> set[ast.AST]:
    """What stands in functions that ask which system it is."""
    asking = [node for node in nodes if isinstance(node, ast.FunctionDef) and "sys.platform ==" in ast.unparse(node)]
    return {inner for node in asking for inner in ast.walk(node)}


def posix_only(nodes: list[ast.AST]) -> list[str]:
    """What a source uses that Windows does not have."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [(node, name.name) for name in node.names if name.name in POSIX_MODULES]
        elif isinstance(node, ast.ImportFrom) and node.module in POSIX_MODULES:
            found.append((node, str(node.module)))
        elif isinstance(node, ast.Attribute) and node.attr in POSIX_NAMES.get(getattr(node.value, "id", ""), ()):
            found.append((node, f"{ast.unparse(node.value)}.{node.attr}"))
    if not found:
        return []
    asked, skipped = guarded_names(nodes), for_one_system(nodes)
    used = [name for node, name in found if node not in skipped]
    return [name for name in used if name.partition(".")[2] not in asked or "." not in name]


def posix_only_of(text: str) -> list[str]:
    return sorted(posix_only(list(ast.walk(ast.parse(text)))))


def test_the_source_uses_nothing_that_windows_lacks(files):
    assert posix_only_of("import fcntl\nos.fork()\nhasattr(os, 'uname') and os.uname()") == ["fcntl", "os.fork"]
    assert posix_only_of("def f():\n    import tty") == ["tty"]
    assert posix_only_of("def f():\n    if sys.platform == 'win32':\n        return\n    import tty") == []
    found = {module: posix_only(source.nodes) for module, source in files.items()}
    assert len(found) > 300
    assert {module: names for module, names in found.items() if names} == {}


def test_no_two_files_differ_in_case_alone_and_no_name_is_reserved_or_long():
    """The file systems of macOS and Windows do not distinguish cases; Windows takes 260 characters for a whole path."""
    names = [str(file.relative_to(SOURCE)) for file in SOURCE.rglob("*") if "__pycache__" not in file.parts]
    assert len({name.lower() for name in names}) == len(names)
    assert not [name for name in names if Path(name).stem.lower() in ("con", "prn", "aux", "nul", "com1", "lpt1")]
    assert max(map(len, names)) < 90  # C:\Users\NAME\...\.venv\Lib\site-packages\truearm is some 100


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "utf-8"])
def test_output_in_an_encoding_that_lacks_characters_is_written_with_the_nearest(encoding):
    code = """if True:
        from truearm import command_line as main
        main.make_app = lambda *_: lambda *args, **options: print("3\\u202f\\u03bcm \\u2212 5 \\u2192 \\xe4 \\u6d4b")
        main.run(["docs"])
    """
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONIOENCODING": encoding}, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    printed = {
        "cp1252": "3 um - 5 -> ä \\u6d4b",
        "ascii": "3 um - 5 -> a\\u0308 \\u6d4b",
        "utf-8": "3\u202f\u03bcm \u2212 5 \u2192 \xe4 \u6d4b",
    }
    assert done.stdout.decode(encoding).rstrip() == printed[encoding]
